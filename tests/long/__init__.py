"""Tests of `make test-long`."""

"""Checks for your own estimators."""

from flightbed.testing.check import ContractError as ContractError
from flightbed.testing.check import check_estimator as check_estimator

"""The two-stage Kalman filter with forgetting (Wu, Zhang and Zhou 2000), for one surface or three, with its test for a change."""

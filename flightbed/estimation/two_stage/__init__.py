"""The two-stage Kalman filter with forgetting, for one surface or three."""

"""The augmented Kalman filter for alpha, q and K."""

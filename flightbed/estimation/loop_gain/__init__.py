"""The augmented Kalman filter for alpha, q and K: estimator, bank of staggered filters, and the filter on the scheduled model."""

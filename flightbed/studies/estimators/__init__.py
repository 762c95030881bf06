"""All estimators, and the user's own, on the same flights: errors of K, alarms, tracking, losses, cost."""

"""Every estimator on the same recordings, in one table."""

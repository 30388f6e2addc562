"""Gauss-Newton on the graph, its elimination, covariance and noise levels."""

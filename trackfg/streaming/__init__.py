"""Estimation while rows arrive: the graph of the batch smoother on a window that moves along."""

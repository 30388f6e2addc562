"""Simulated sensors and clocks, their errors and their faults."""

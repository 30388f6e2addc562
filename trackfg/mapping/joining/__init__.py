"""Joining runs into one map."""

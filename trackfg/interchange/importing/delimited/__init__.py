"""Delimited text is read: its dialect is guessed, and every fault in it has a row."""

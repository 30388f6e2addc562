"""Scores of an estimate against truth."""

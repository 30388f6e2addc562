"""Sinks take a stream's estimates: JSON lines, a callback, Parquet parts."""

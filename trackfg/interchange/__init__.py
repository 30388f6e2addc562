"""Recordings come from other systems (``importing``), and results go to them (``exporting``)."""

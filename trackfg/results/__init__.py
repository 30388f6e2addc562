"""The format of a result: its columns, its tables and its summary."""

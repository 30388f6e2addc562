"""The intake turns a source's batches into complete, sound rows in order."""

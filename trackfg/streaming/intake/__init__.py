"""From a source's batches to complete, sound rows in order."""

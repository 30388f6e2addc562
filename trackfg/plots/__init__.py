"""Charts of results, as pictures and as pages."""

"""A fleet's runs: what is to be smoothed, what is there already, every run in a process of its own, one store."""

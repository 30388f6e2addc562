"""``trackfg browse``: the pages of a store, served on this machine."""

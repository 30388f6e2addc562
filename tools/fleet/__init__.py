"""A made-up fleet is computed in every way that there is, with faults on the way, and must come out the same."""

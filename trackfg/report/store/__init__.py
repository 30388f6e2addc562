"""The pages of a store of runs: all lines and runs, a line by sections, and a section with its runs over each other."""

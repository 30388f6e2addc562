"""Parts of a proposed mapping, with a question for each thing that the data cannot say."""

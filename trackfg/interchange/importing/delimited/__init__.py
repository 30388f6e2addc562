"""Delimited text is read: its dialect is guessed, and every fault in it has a row.

===================  =============================================================================================
module               content
===================  =============================================================================================
``dialect``          how a file is written, guessed from its first part
``encoding``         the encoding of a text
``cells``            what a cell holds
``separators``       the delimiter between cells, and the decimal sign in them
``data_rows``        which lines are rows of data
``header``           names and units of the columns
``written_numbers``  numbers that are written as text
``tagged_lines``     text whose lines begin with what they are
``text_table``       a file as a table
===================  =============================================================================================
"""

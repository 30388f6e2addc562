"""Published systems, rebuilt to be compared with the smoother: a recording in, the smoother's tables out.

Each module is one paper, with the paper's symbols, equation numbers and defaults. What the papers print wrongly is
corrected unless ``as_printed=True``; the module says where the two differ.
"""

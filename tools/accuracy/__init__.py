"""Errors and sigmas against truth: ``python tools/geometry_accuracy.py``, ``consistency.py``, ``curve_detection.py``,
``change_detection.py``, ``assumptions.py``, ``real_data.py``, ``real_data_facts.py``.
"""

"""Time and memory: ``python tools/speed.py``, ``report_speed.py``, ``simulation_speed.py`` and
``map_storage_speed.py``.
"""

"""Logs of satellite receivers, solutions and tracks: positions that lie beside the table of an inertial sensor."""

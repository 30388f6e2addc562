"""The clocks of a run's sensors are corrected before its graph is solved, or it is solved again on moved stamps."""

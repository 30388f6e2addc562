"""What each sensor's samples say before any graph: intervals of the IMU, counts of the tach, rests, displacements."""

"""The filters of an inertial sensor leave out short waves, and delay one of its sensors against the other."""

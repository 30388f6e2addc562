"""What the filters of an inertial sensor leave out, and by how much they delay one of its sensors against the other."""

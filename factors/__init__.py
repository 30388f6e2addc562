"""Every factor of the graph. Families of our own are written over arrays; the inertial factors are GTSAM's."""

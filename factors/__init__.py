"""Every factor of the graph is here. Families of our own are written over arrays; the inertial factors are GTSAM's."""

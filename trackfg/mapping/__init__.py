"""What runs over one line say together: where each lies on the map, and what they add to it."""

"""The line of a simulated world: alignment, profile, irregularities; line files and LandXML."""

"""Track geometry: operators along the chainage, each with its exact wavelength response, and judging with them."""

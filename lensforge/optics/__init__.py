"""Matter that light meets: media, materials, coatings, the bounds set by étendue, and images of light."""

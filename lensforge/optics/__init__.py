"""What light meets: media, materials, coatings, the limits that étendue sets, and images as light."""

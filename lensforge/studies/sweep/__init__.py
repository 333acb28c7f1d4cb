"""One design for each of several values of a field, such as the maximum radius, and its effect on the light."""

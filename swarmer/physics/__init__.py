"""How the world answers an FLS: flights that miss, velocities, sensors. Pure; chance only by the generator given."""

"""How the world answers an FLS: flights that miss, velocities, sensors. Pure; random only by the generator handed in."""

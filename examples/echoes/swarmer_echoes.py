"""Echoes: a sample is exact, or it is of a signal that came the long way, and the distance is too large."""


def echoes(share, accurate_probability):
    """A model of errors. It gives the function that draws by what factor one sample is off.

    share: `sensing.error_percent` as a fraction; here the farthest detour.
    accurate_probability: `sensing.accurate_probability`; here that a sample is of the direct signal.
    """

    def draw(rng):
        detour = rng.uniform(0.0, share)  # drawn also where it is not used: later draws stay what they are
        return 1.0 if rng.random() < accurate_probability else 1.0 + detour

    return draw

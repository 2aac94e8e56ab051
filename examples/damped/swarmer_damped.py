"""Damped: fly a part of the way only, so that a bad measurement does less harm."""

Vec3 = tuple[float, float, float]
SHARE = 0.7


class Damped:
    """V = SHARE (d - D). Later localizations correct what is left over."""

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """The vector to fly, display cells.

        measured: from this FLS to its anchor, as sensed.
        ground_truth: the same vector between their points.
        """
        pairs = zip(measured, ground_truth, strict=True)
        x, y, z = (SHARE * (d - g) for d, g in pairs)
        return (x, y, z)

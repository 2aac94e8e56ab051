"""Damped: fly only a part of the vector that Signal Strength would, so that a noisy measurement does less harm."""

Vec3 = tuple[float, float, float]
SHARE = 0.7


class Damped:
    """V = SHARE (d - D). What is left over is corrected after the next thaws, against other anchors."""

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """The vector to fly, display cells.

        measured: from this FLS to its anchor, as sensed. ground_truth: the same vector between their points.
        """
        d, g = measured, ground_truth
        return (SHARE * (d[0] - g[0]), SHARE * (d[1] - g[1]), SHARE * (d[2] - g[2]))

"""What a technique answers for many FLSs at once, as the rounds engine asks: what it must look like, and a trial."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmer.messages import LARGEST, Vec3
from swarmer.plugins import NoFix, references_of
from swarmer.plugins.fixing import FIXED, Fixes
from swarmer.plugins.guard import TRIED, Watched, vector_of

Vectors = NDArray[np.float64]


def like(vectors: Vectors) -> Callable[[Any], Vectors]:
    """What checks that an answer has as many vectors, finite and none beyond what a datagram may hold."""

    def check(answer: Any) -> Vectors:
        found = np.asarray(answer)
        if found.shape != vectors.shape or not np.issubdtype(found.dtype, np.number):
            raise ValueError(f"gave an array {found.dtype}{found.shape}, not numbers {vectors.shape}")
        if not np.isfinite(found).all():
            raise ValueError("gave vectors that are not finite")
        if np.abs(found).max(initial=0.0) > LARGEST:
            raise ValueError(f"gave a vector that is farther than {LARGEST:g} cells")
        return found.astype(np.float64, copy=False)

    return check


def many_like(vectors: Vectors) -> Callable[[Any], list[Vectors]]:
    """What checks that an answer is a list of such arrays."""
    check = like(vectors)
    return lambda answers: [check(one) for one in answers]


def fix_of(value: Any) -> Vec3 | str:
    """A vector, or the reason why there is none. Raises ValueError, which says what it is instead."""
    return (str(value) or "no_fix") if isinstance(value, NoFix) else vector_of(value)


def fixes_of(found: Fixes) -> Fixes:
    """The same, if what is fixed is finite. Raises ValueError."""
    fixed = found.failure == FIXED
    if found.vector.ndim != 2 or found.vector.shape[1] != 3 or not np.isfinite(found.vector[fixed]).all():
        raise ValueError("gave fixes that are not finite vectors")
    if np.abs(found.vector[fixed]).max(initial=0.0) > LARGEST:
        raise ValueError(f"gave a fix that is farther than {LARGEST:g} cells")
    return found


def fix_or_reason(technique: Any, measured: list[Vec3], ground_truth: list[Vec3], dim: int) -> Any:
    """What `fix` gives, or the NoFix that it raises."""
    try:
        return technique.fix(measured, ground_truth, dim)
    except NoFix as none:
        return none


def tuples(vectors: Vectors) -> list[Vec3]:
    """The rows of an (n, 3) array, as a technique for one FLS takes them."""
    return [(x, y, z) for x, y, z in vectors.tolist()]


def try_many(watched: Watched, technique: Any, dim: int) -> None:
    """Ask a technique what the rounds engine asks beyond `displacement`. Raises PluginFailed."""
    if references_of(technique, dim) > 1:
        _try_fixes(watched, technique, dim)
        return
    measured, ground_truth = (np.array(vectors) for vectors in zip(*TRIED, strict=True))
    if hasattr(technique, "displacements"):
        watched.call("displacements", like(measured), technique.displacements, measured, ground_truth)
    if hasattr(technique, "legs_of_many"):
        watched.call("legs_of_many", many_like(measured), technique.legs_of_many, measured, ground_truth)


def _try_fixes(watched: Watched, technique: Any, dim: int) -> None:
    """Two FLSs whose references stand all around them; the second measures them where they should be."""
    k = references_of(technique, dim)
    turn = 2 * np.pi * np.arange(k) / k + 0.3
    depth = np.where(np.arange(k) % 2, -1.0, 1.5) if dim == 3 else np.zeros(k)
    ground_truth = np.stack([np.stack([3 * np.cos(turn), 2 * np.sin(turn), depth], axis=1)] * 2)
    measured = ground_truth + np.array([[[0.2, -0.1, 0.0]], [[0.0, 0.0, 0.0]]])
    if not hasattr(technique, "fixes"):
        for d, g in zip(measured, ground_truth, strict=True):
            watched.call("fix", fix_of, fix_or_reason, technique, tuples(d), tuples(g), dim)
        return
    found = watched.call("fixes", fixes_of, technique.fixes, measured, ground_truth, dim)
    if len(found.vector) != len(measured):
        watched.fail(f"fixes gave {len(found.vector)} vectors for {len(measured)} FLSs")

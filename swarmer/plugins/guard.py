"""What other packages add is tried before a run and watched in it: whatever goes wrong is named, with its package.

`try_*` ask it while a run is planned, and raise BadInput; what an FLS uses raises PluginFailed in the run. Our own
things are not guarded, and pay nothing: this file is imported when there is a plugin of another package.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from importlib import import_module
from numbers import Real
from random import Random
from typing import TYPE_CHECKING, Any, NoReturn

from swarmer.entry_points import SENSOR_ERRORS, TECHNIQUES, THAW_POLICIES, at
from swarmer.errors import BadInput, PluginFailed, shown
from swarmer.messages import LARGEST, Vec3

if TYPE_CHECKING:
    from swarmer.physics.sensing import SensorErrorModel

SETTING = {TECHNIQUES: "technique", SENSOR_ERRORS: "sensing.model", THAW_POLICIES: "thaw.policy"}
POLICY_METHODS = ("delay_s", "begins", "joined", "report_due", "counted", "called", "announced", "aborted")
TRIED: tuple[tuple[Vec3, Vec3], ...] = (
    ((3.0, -1.0, 2.0), (2.0, 0.5, 2.0)),
    ((0.1, 0.0, 0.0), (5.0, 5.0, 0.0)),
    ((-40.0, 25.0, 7.0), (-40.0, 25.0, 7.0)),
)
"""Pairs of a measured vector and the ground truth that a technique is tried with: usual, flat and far off, perfect."""


def load(place: str) -> Any:
    """What is at "module:attribute". Raises what its import raises."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def vector_of(value: Any) -> Vec3:
    """Three numbers as floats, none beyond what a datagram may hold. Raises ValueError, which says what is wrong."""
    try:
        parts = tuple(value)
    except TypeError:
        raise ValueError(f"gave {shown(value)}, not three numbers") from None
    if len(parts) != 3 or not all(isinstance(part, Real) for part in parts):
        raise ValueError(f"gave {shown(value)}, not three numbers")
    x, y, z = map(float, parts)
    if not math.isfinite(x + y + z):
        raise ValueError(f"gave {shown(value)}, which is not finite")
    if max(map(abs, (x, y, z))) > LARGEST:
        raise ValueError(f"gave {shown(value)}, which is farther than {LARGEST:g} cells")
    return (x, y, z)


def number_of(value: Any) -> float:
    """A number as a float, not beyond what a datagram may hold. Raises ValueError, which says what it is instead."""
    if not isinstance(value, Real) or not math.isfinite(value):
        raise ValueError(f"gave {shown(value)}, not a finite number")
    number = float(value)
    if abs(number) > LARGEST:
        raise ValueError(f"gave {shown(value)}, which is beyond {LARGEST:g}")
    return number


class Watched:
    """Calls a plugin's code, and puts its name and its package to whatever goes wrong."""

    __slots__ = ("_group", "_place")

    def __init__(self, group: str, place: str) -> None:
        self._group, self._place = group, place

    def call(
        self, what: str, check: Callable[[Any], Any], function: Callable[..., Any], *arguments: Any
    ) -> Any:
        """`check(function(*arguments))`. what: what is called, in words. Raises PluginFailed."""
        try:
            return check(function(*arguments))
        except PluginFailed:
            raise
        except (Exception, SystemExit) as error:
            raise PluginFailed(f"{self.lead}: {what} {_said(error)}") from error

    def fail(self, what: str) -> NoReturn:
        """Raises PluginFailed for something that nobody called."""
        raise PluginFailed(f"{self.lead}: {what}")

    @property
    def lead(self) -> str:
        """`technique: 'damped' of the package swarmer-damped 0.1`."""
        plugin = at(self._group, self._place)
        return f"{SETTING[self._group]}: {plugin.name!r} of the package {plugin.package}"

    def loaded(self) -> Any:
        """The class or function itself."""
        return self.call("cannot be imported:", as_it_is, load, self._place)


def _said(error: BaseException) -> str:
    if type(error) is ValueError and str(error).startswith("gave "):
        return str(error)
    text = " ".join(str(error).split())
    return f"raised {type(error).__name__}" + (f": {shown(text)[1:-1]}" if text else "")


def as_it_is(value: Any) -> Any:
    """What needs no check."""
    return value


# -- techniques --------------------------------------------------------------------------------------------------------


def make_technique(place: str) -> Any:
    """The technique at "module:class", as it is: whoever calls it is to watch it. Raises PluginFailed."""
    watched = Watched(TECHNIQUES, place)
    return watched.call("made without arguments", _technique, watched.loaded())


class GuardedLocalizer(Watched):
    """A technique of another package that needs one reference."""

    __slots__ = ("_inner", "legs")

    def __init__(self, place: str) -> None:
        super().__init__(TECHNIQUES, place)
        self._inner = make_technique(place)
        if hasattr(self._inner, "legs"):
            self.legs = self._legs

    def displacement(self, measured: Vec3, ground_truth: Vec3) -> Vec3:
        """As the plugin has it, or PluginFailed."""
        vector: Vec3 = self.call(
            f"displacement({_short(measured)}, {_short(ground_truth)})",
            vector_of, self._inner.displacement, measured, ground_truth,
        )  # fmt: skip
        return vector

    def _legs(self, measured: Vec3, ground_truth: Vec3) -> tuple[Vec3, ...]:
        legs: tuple[Vec3, ...] = self.call(
            f"legs({_short(measured)}, {_short(ground_truth)})",
            legs_of, self._inner.legs, measured, ground_truth,
        )  # fmt: skip
        return legs


def try_localizer(place: str, dim: int, in_rounds: bool) -> None:
    """Ask a technique some questions that have an answer. Raises BadInput.

    in_rounds: also what the engine rounds alone asks, in a display of 2 or 3 dimensions. Of several references it is
    asked there whether it gives a vector or says why not.
    """
    with refusing():
        localizer = GuardedLocalizer(place)
        technique = make_technique(place)
        if not hasattr(technique, "fix"):
            for measured, ground_truth in TRIED:
                localizer.displacement(measured, ground_truth)
                getattr(localizer, "legs", lambda *_: ())(measured, ground_truth)
        if in_rounds:
            from swarmer.plugins.arrays import (
                try_many,
            )  # only here: FLS processes, without numpy, import this file

            try_many(localizer, technique, dim)


def _technique(value: Any) -> Any:
    if not hasattr(value, "displacement") and not hasattr(value, "fix"):
        raise ValueError(f"gave {shown(value)}, which has no displacement")
    for name in ("references", "references_3d"):
        needed = getattr(value, name, 0)
        if not isinstance(needed, int) or needed < 0:
            raise ValueError(f"gave what has {name} {shown(needed)}, not a whole number from 0")
        if needed > 1 and not hasattr(value, "fix"):
            raise ValueError(f"gave what has {name} {needed}, and no fix")
    return value


def legs_of(value: Any) -> tuple[Vec3, ...]:
    """One vector or more. Raises ValueError, which says what it is instead."""
    legs = tuple(map(vector_of, value))
    if not legs:
        raise ValueError(f"gave {shown(value)}, not one leg or more")
    return legs


# -- errors of sensors -------------------------------------------------------------------------------------------------


def make_sensor_error(place: str, share: float, accurate_probability: float) -> SensorErrorModel:
    """The error model at "module:function". Raises PluginFailed, and so does what it gives."""
    watched = Watched(SENSOR_ERRORS, place)
    draw = watched.call(
        f"({share:g}, {accurate_probability:g})", _callable, watched.loaded(), share, accurate_probability
    )
    return lambda rng: watched.call("a draw", number_of, draw, rng)


def try_sensor_error(place: str, share: float, accurate_probability: float) -> None:
    """Draw some errors. Raises BadInput."""
    with refusing():
        draw, rng = make_sensor_error(place, share, accurate_probability), Random(1)
        for _ in range(20):
            draw(rng)


def _callable(value: Any) -> Any:
    if not callable(value):
        raise ValueError(f"gave {shown(value)}, not a function of a generator")
    return value


# -- thaw policies -----------------------------------------------------------------------------------------------------


class GuardedPolicy(Watched):
    """A thaw policy of another package."""

    __slots__ = ("_inner", "tells")

    def __init__(self, place: str, count: int, h_s: float, spread: float) -> None:
        super().__init__(THAW_POLICIES, place)
        self._inner = self.call(f"({count}, {h_s:g}, {spread:g})", _policy, self.loaded(), count, h_s, spread)
        self.tells = bool(self._inner.tells)

    def delay_s(self, rng: Random) -> float | None:
        delay: float | None = self.call("delay_s", _delay, self._inner.delay_s, rng)
        return delay

    def begins(self, me: Any) -> None:
        self.call("begins", as_it_is, self._inner.begins, me)

    def joined(self, me: Any, left: Any) -> None:
        self.call("joined", as_it_is, self._inner.joined, me, left)

    def report_due(self, me: Any) -> bool:
        return bool(self.call("report_due", as_it_is, self._inner.report_due, me))

    def counted(self, me: Any, message: Any) -> bool:
        return bool(self.call("counted", as_it_is, self._inner.counted, me, message))

    def called(self, me: Any, message: Any) -> None:
        self.call("called", as_it_is, self._inner.called, me, message)

    def announced(self, me: Any, message: Any) -> bool:
        return bool(self.call("announced", as_it_is, self._inner.announced, me, message))

    def aborted(self, me: Any, message: Any) -> None:
        self.call("aborted", as_it_is, self._inner.aborted, me, message)


def try_policy(place: str, count: int, h_s: float, spread: float, epochs: bool) -> None:
    """Make one, and ask it for some delays. Raises BadInput."""
    with refusing():
        policy, rng = GuardedPolicy(place, count, h_s, spread), Random(1)
        for _ in range(20):
            policy.delay_s(rng)
        if not epochs and getattr(load(place), "needs_epochs", True):
            raise PluginFailed(f"{policy.lead}: needs epochs: true, or late reports would count")


def _policy(value: Any) -> Any:
    missing = [name for name in (*POLICY_METHODS, "tells") if not hasattr(value, name)]
    if missing:
        raise ValueError(
            f"gave what has no {missing[0]}; swarmer.protocol.thaw.Silent has all that a policy needs"
        )
    return value


def _delay(value: Any) -> float | None:
    if value is None:
        return None
    delay = number_of(value)
    if delay <= 0:
        raise ValueError(f"gave {shown(value)}, not None or seconds above 0")
    return delay


# -- all ---------------------------------------------------------------------------------------------------------------


def _short(vector: Vec3) -> str:
    return f"({', '.join(f'{part:g}' for part in vector)})"


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Within it, what a plugin does wrong is bad input: nothing has begun yet."""
    try:
        yield
    except PluginFailed as failure:
        raise BadInput.saying(str(failure)) from None

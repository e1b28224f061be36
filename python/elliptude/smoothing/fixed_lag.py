"""Fixed lag, for streams: a guaranteed filter that remembers its last moments; theory, section 20.5."""

import copy
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Any

import numpy as np

import elliptude
from elliptude.errors import PredictionError
from elliptude.results import CLAIMS
from elliptude.smoothing.fusion import StateSets, common, log_sizes
from elliptude.smoothing.mirror import mirrored_flow
from elliptude.typing import FloatArray

_SIGNS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
_UNCONDITIONAL, _CONDITIONAL, _NONE = range(3)
_Move = Callable[[elliptude.GuaranteedFilter, float], None]


@dataclass(frozen=True, eq=False)
class SmoothedSet:
    """What was possible at an earlier moment, by all that was measured until now."""

    time: float
    """s."""
    ellipsoid: elliptude.StateEllipsoid | None
    """In the Gibbs chart; None without a claim."""
    vector: FloatArray | None
    """Center of the angular velocity or the bias by itself, rad/s."""
    vector_shape: FloatArray | None
    """Its ellipsoid: where the claim is the same, no wider than the filter's was then, as the set may be there."""
    claim: str
    """What it rests on, as `GuaranteedFilter.claim`."""
    uses_future: bool
    """Whether what was measured since has changed it."""


@dataclass(frozen=True, eq=False)
class _Known:
    ellipsoid: elliptude.StateEllipsoid | None
    claim: int


@dataclass(frozen=True, eq=False)
class _Moment:
    time: float
    duration: float
    """How long the interval is that led to it, s."""
    move_back: _Move
    """Predicts a filter of the mirrored flow to a time over that interval."""
    known: _Known
    contradictions: int
    """How many updates had contradicted until then."""


@dataclass(frozen=True, eq=False)
class _ByMotion:
    """The way back over a prediction; no function within a function, so that pickle can store it."""

    motion: dict[str, Any]
    """What `predict` of the mirrored flow is given, by its names."""

    def __call__(self, back: elliptude.GuaranteedFilter, until: float) -> None:
        back.predict(until, **self.motion)


@dataclass(frozen=True, eq=False)
class _ByTurn:
    """The way back over a turn."""

    opposite: FloatArray
    bound: float

    def __call__(self, back: elliptude.GuaranteedFilter, until: float) -> None:
        back.predict_turn(until, self.opposite, self.bound)


def _nowhere(_back: elliptude.GuaranteedFilter, _until: float) -> None:
    """The way back from the first moment."""


class FixedLagSmoother:
    """A guaranteed filter and its last moments: what was possible then, with what was measured since.

    A moment is what the filter knew before a prediction. From the present set the mirrored flow goes backward, moment
    by moment, and each time the set is combined with what the filter knew then. The truth is in it as it is in the
    filter's sets. Where its claim is that of the filter then, it is no larger by the criterion, and no wider in its
    largest angle, nor is the vector by itself. Where the claim is stronger, they may be.

    Before a contradiction that the filter itself has met, and got over by its policy, its sets may have been wrong
    already without showing it. So nothing of them is carried to earlier moments: only what was known after the dispute
    is. Where such a set and what was known after have nothing in common, that is no new contradiction: the latter is
    shown, called conditional.

    Parameters
    ----------
    filter : GuaranteedFilter
        As it is now: the first moment. Predictions and updates are to go through the smoother from now on, and so is
        `forget`: after any that did not, the smoother's functions raise `ValueError`, until `FixedLagSmoother.forget`.
        A copy of the smoother has a filter of its own. What pickle stores is as `GuaranteedFilter`'s.
    lag : int
        How many moments are remembered besides the present one, 1 or more.

    Raises
    ------
    ValueError
        If the lag is less than 1, or the motion cannot be followed backward: a potential of which nothing is stated.
    """

    def __init__(self, filter: elliptude.GuaranteedFilter, lag: int) -> None:  # noqa: A002
        if lag < 1:
            raise ValueError(f"lag is {lag}, but a smoother remembers at least one moment")
        mirrored_flow(filter.flow)
        self._filter = filter
        self._moments: deque[_Moment] = deque(maxlen=lag + 1)
        self._has_contradicted: bool = False
        self._begin()

    def __getstate__(self) -> dict[str, Any]:
        """What copies and pickle keep: what changes is the copy's own."""
        return vars(self) | {"_filter": copy.copy(self._filter), "_moments": self._moments.copy()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """What pickle stored, also before the smoother knew how it had left its filter."""
        missing = {"_filter", "_moments", "_has_contradicted"} - state.keys()
        for moment in state.get("_moments", ()):
            missing |= {field.name for field in fields(_Moment)} - vars(moment).keys()
        if missing:
            raise ValueError(f"a smoother that another version of elliptude stored: it has no {min(missing)!r}")
        vars(self).update(state)
        if "_left" not in state:
            # What has gone on beside the smoother shows in the moment, or has changed neither set nor claim.
            self._left = self._filter._knowledge() if self._is_as_moment(self._moments[-1]) else {}

    def _is_as_moment(self, moment: _Moment) -> bool:
        """Whether the filter knows what it knew at a moment."""
        now = self._filter
        known = _Known(now.ellipsoid, CLAIMS.index(now.claim))
        is_then = (now.time, known.claim, now._contradictions) == (
            moment.time,
            moment.known.claim,
            moment.contradictions,
        )
        return is_then and known.ellipsoid == moment.known.ellipsoid

    @property
    def filter(self) -> elliptude.GuaranteedFilter:
        """The filter, to ask."""
        return self._filter

    @property
    def moments(self) -> int:
        """How many moments there are, with the present one: 1 to lag + 1."""
        return len(self._moments)

    @property
    def has_contradicted(self) -> bool:
        """Whether `smoothed` found a new contradiction of a past and its future; never under `raise`."""
        return self._has_contradicted

    def forget(self) -> None:
        """Forget as `GuaranteedFilter.forget`, and the moments, too."""
        self._filter.forget()
        self._begin()

    def predict(self, time: float, **motion: Any) -> None:
        """Predict as `GuaranteedFilter.predict`. A prediction over no time begins no moment, but a turn does."""
        self._refuse_other_use()
        duration = time - self._filter.time
        self._filter.predict(time, **motion)
        kept: dict[str, Any] = {name: np.array(value)[()] for name, value in motion.items() if value is not None}

        for name in ("gyro", "wheel_momentum"):
            if name in kept:
                kept[name] = -kept[name]
        self._append(duration, _ByMotion(kept))

    def predict_turn(self, time: float, turn: FloatArray, turn_bound: float) -> None:
        """Predict as `GuaranteedFilter.predict_turn`."""
        self._refuse_other_use()
        duration = time - self._filter.time
        self._filter.predict_turn(time, turn, turn_bound)
        self._append(duration, _ByTurn(-np.array(turn, dtype=np.float64), float(turn_bound)), is_turn=True)

    def update(self, *measured: Any, **more: Any) -> elliptude.GuaranteedUpdate:
        """Update as `GuaranteedFilter.update`."""
        self._refuse_other_use()
        report = self._filter.update(*measured, **more)
        self._replace_present()
        return report

    def smoothed(self, age: int) -> SmoothedSet:
        """What was possible some moments ago, by all that was measured until now.

        Parameters
        ----------
        age : int
            How many moments ago; 0 is the present.

        Returns
        -------
        SmoothedSet

        Raises
        ------
        IndexError
            If so many moments are not remembered.
        InconsistentMeasurement
            If past and future prove that a statement is wrong, and the policy is to raise. Under the others no smoothed
            set is unconditional from then on.
        """
        if not 0 <= age < len(self._moments):
            raise IndexError(f"age is {age}, but there are {len(self._moments)} moments")
        self._refuse_other_use()
        moments = list(self._moments)[::-1]
        contradicted = self._has_contradicted
        shown = carried = of_vector = _weakened(moments[0].known, contradicted)
        for later, earlier in pairwise(moments[: age + 1]):
            future = self._backward(later, _weakened(carried, contradicted))
            past = _weakened(earlier.known, contradicted)
            (shown, smallest, of_vector), are_apart = self._both(past, future)
            is_before_dispute = earlier.contradictions != moments[0].contradictions
            if are_apart and is_before_dispute:
                shown = of_vector = _Known(future.ellipsoid, _CONDITIONAL)
            contradicts = are_apart and not is_before_dispute and past.claim == _UNCONDITIONAL
            carried = future if is_before_dispute else smallest
            if contradicts and self._filter.policy == "raise":
                raise elliptude.InconsistentMeasurement(
                    f"what is known from before {earlier.time:.6f} s and from after it has nothing in common; some "
                    "bound is wrong",
                    np.nan,
                    earlier.time,
                    "",
                    None,
                )
            contradicted = contradicted or contradicts
        self._has_contradicted = contradicted
        known = of_vector.ellipsoid
        return SmoothedSet(
            moments[age].time,
            shown.ellipsoid,
            None if known is None else known.vector,
            None if known is None else known.shape[3:, 3:],
            CLAIMS[_weakened(shown, contradicted).claim],
            shown.ellipsoid is not moments[age].known.ellipsoid,
        )

    def _begin(self) -> None:
        self._moments.clear()
        self._has_contradicted = False
        self._add(0.0, _nowhere)

    def _refuse_other_use(self) -> None:
        """The moments lead to the state in which the smoother left the filter, and to no other."""
        left_at = self._moments[-1].time
        if self._filter.time != left_at:
            raise ValueError(
                f"filter is at {self._filter.time:.6f} s, but its smoother left it at {left_at:.6f} s: "
                "predictions go through the smoother"
            )
        if self._filter._knowledge() != self._left:
            raise ValueError(
                f"filter is not as its smoother left it at {left_at:.6f} s: updates go through the smoother, and so "
                "does forget"
            )

    def _append(self, duration: float, move_back: _Move, *, is_turn: bool = False) -> None:
        if duration > 0.0 or is_turn:
            self._add(duration, move_back)
        else:
            self._replace_present()

    def _replace_present(self) -> None:
        last = self._moments.pop()
        self._add(last.duration, last.move_back)

    def _add(self, duration: float, move_back: _Move) -> None:
        now = self._filter
        known = _Known(now.ellipsoid, CLAIMS.index(now.claim))
        self._moments.append(_Moment(now.time, duration, move_back, known, now._contradictions))
        self._left = now._knowledge()

    @property
    def _is_product(self) -> bool:
        return not self._filter.estimate_vector and self._filter.vector_bound is not None

    def _backward(self, later: _Moment, known: _Known) -> _Known:
        """From a set at the end of an interval to one at its beginning; none where it cannot be followed.

        What a user's torque raises comes out, as it does from a prediction.
        """
        if known.ellipsoid is None:
            return _Known(None, _NONE)
        bound = self._filter.vector_bound
        try:
            back = elliptude.GuaranteedFilter(
                mirrored_flow(self._filter.flow),
                _mirrored(known.ellipsoid),
                time=-later.time,
                criterion=self._filter.criterion,
                weight=self._filter.weight,
                vector_bound=None if bound is None else (-bound[0], bound[1]),
                estimate_vector=self._filter.estimate_vector,
            )
        except ValueError:  # a set that nothing can start from, as one that the motion has taken out of its bound
            return _Known(None, _NONE)
        try:
            later.move_back(back, -later.time + later.duration)
        except PredictionError:
            return _Known(None, _NONE)
        found = back.ellipsoid
        return _Known(None, _NONE) if found is None else _Known(_mirrored(found), known.claim)

    def _both(self, past: _Known, future: _Known) -> tuple[tuple[_Known, _Known, _Known], bool]:
        """What is shown, the smallest, what says most of the vector, and whether equal claims are of sets apart."""
        if future.claim < past.claim:
            return (future, future, future), False
        if future.claim > past.claim or past.ellipsoid is None or future.ellipsoid is None:
            return (past, past, past), False
        k = 3 if self._is_product else 6
        weight = None
        if self._filter.criterion != "volume":
            weight = np.eye(6) if self._filter.weight is None else self._filter.weight
            weight = weight[:k, :k]
        one, other = _state_sets(past.ellipsoid, k), _state_sets(future.ellipsoid, k)
        found = common(one, other, weight)
        if not found.meet[0]:
            return (past, past, past), True
        if not log_sizes(found.sets.shapes, weight)[0] < log_sizes(one.shapes, weight)[0]:
            return (past, past, past), False
        before = past.ellipsoid.shape
        vector, shape = past.ellipsoid.vector.copy(), before.copy()
        vector[: k - 3], shape[:k, :k] = found.sets.vectors[0], found.sets.shapes[0]
        smallest = _Known(elliptude.StateEllipsoid(found.sets.attitudes[0], vector, shape, chart="gibbs"), past.claim)
        shown = smallest if _largest(shape[:3, :3]) <= _largest(before[:3, :3]) else past
        of_vector = smallest if _largest(shape[3:, 3:]) <= _largest(before[3:, 3:]) else past
        return (shown, smallest, of_vector), False


def _weakened(known: _Known, contradicted: bool) -> _Known:
    """With the claim that is left once a statement is known to be wrong."""
    return _Known(known.ellipsoid, _CONDITIONAL) if contradicted and known.claim == _UNCONDITIONAL else known


def _mirrored(found: elliptude.StateEllipsoid) -> elliptude.StateEllipsoid:
    """A set in the other direction of time."""
    return elliptude.StateEllipsoid(
        found.attitude, -found.vector, found.shape * np.outer(_SIGNS, _SIGNS), chart="gibbs"
    )


def _state_sets(found: elliptude.StateEllipsoid, k: int) -> StateSets:
    return StateSets(found.attitude[None], found.vector[None, : k - 3], found.shape[None, :k, :k])


def _largest(shape: FloatArray) -> float:
    return float(np.linalg.eigvalsh(shape)[-1])

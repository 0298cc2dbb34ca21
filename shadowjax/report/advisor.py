"""Which technique to take for a scene, and why: chosen from measured records by one stated rule."""

from collections.abc import Sequence
from dataclasses import dataclass

from shadowjax.evaluate.records import Record

# Techniques whose error is within this factor of the lowest count as equally good.
AS_GOOD = 1.10
# A technique with at least this many tones has soft edges.
SMOOTH_TONES = 8


@dataclass(frozen=True)
class Choice:
    """One measured way to shadow a scene.

    Args:
        resolution: Texels along each side of a map.
        record: What was measured.
    """

    resolution: int
    record: Record

    @property
    def name(self) -> str:
        """Technique and resolution for people."""
        return f"{self.record.technique} at {self.resolution}²"

    @property
    def total_ms(self) -> float:
        """Maps and lookups of one picture, milliseconds."""
        return self.record.build_ms + self.record.visibility_ms

    def costs(self) -> tuple[float, int, float]:
        """Error of received light, bytes and time: less is better in each."""
        return self.error, self.record.map_bytes, self.total_ms

    @property
    def error(self) -> float:
        """Error of the light that surfaces receive."""
        return self.record.light_rmse

    @property
    def is_smooth(self) -> bool:
        """Whether its shadow edges have half-tones enough to look soft."""
        return self.record.tones >= SMOOTH_TONES


@dataclass(frozen=True)
class Advice:
    """A recommendation with its reasons.

    Args:
        recommended: As good as the best (within 10 % of its error), least memory, then least time.
        smooth: The same among techniques with at least 8 tones; None where none was measured.
        most_accurate: Lowest error of all.
        fastest: Least time of all.
        front: Names that nothing measured beats in error, memory and time together.
        reasons: Sentences for people.
    """

    recommended: Choice
    smooth: Choice | None
    most_accurate: Choice
    fastest: Choice
    front: tuple[str, ...]
    reasons: tuple[str, ...]


def pareto_front(choices: Sequence[Choice]) -> tuple[str, ...]:
    """Names of the choices that no other one matches or beats in every cost while beating it in one."""

    def beaten(choice: Choice) -> bool:
        mine = choice.costs()
        return any(
            other.costs() != mine and all(theirs <= own for theirs, own in zip(other.costs(), mine, strict=True))
            for other in choices
        )

    return tuple(choice.name for choice in choices if not beaten(choice))


def advise(choices: Sequence[Choice]) -> Advice | None:
    """Choose among measured techniques; None if none of them stores a map.

    Args:
        choices: Measured on one view. Techniques without a map (the exact shadow itself) are left aside.
    """
    mapped = [choice for choice in choices if choice.record.map_bytes > 0]
    if not mapped:
        return None
    best = min(mapped, key=lambda choice: choice.error)
    chosen, smooth = _lightest(mapped), _lightest([choice for choice in mapped if choice.is_smooth])
    assert chosen is not None
    fastest = min(mapped, key=lambda choice: choice.total_ms)
    reasons = _reasons(mapped, chosen, smooth, best, fastest)
    return Advice(chosen, smooth, best, fastest, pareto_front(mapped), reasons)


def _as_good(choices: Sequence[Choice]) -> list[Choice]:
    """Choices whose error is within 10 % of the lowest."""
    lowest = min(choice.error for choice in choices)
    return [choice for choice in choices if choice.error <= AS_GOOD * lowest]


def _lightest(choices: Sequence[Choice]) -> Choice | None:
    """Of those as good as the best, the one with the least memory, then the least time."""
    return min(_as_good(choices), key=lambda one: (one.record.map_bytes, one.total_ms)) if choices else None


def _reasons(
    mapped: Sequence[Choice], chosen: Choice, smooth: Choice | None, best: Choice, fastest: Choice
) -> tuple[str, ...]:
    """Why, in numbers that were measured."""
    equals = len(_as_good(mapped))
    sentences = [
        f"{len(mapped)} combinations were measured on this view. The lowest error of received light is "
        f"{_percent(best.error)} ({best.name}); {equals} stay within {100 * (AS_GOOD - 1):.0f} % of it."
    ]
    if equals > 1:
        sentences.append(f"Of these, {chosen.name} needs the least memory, {bytes_text(chosen.record.map_bytes)}.")
    if smooth is not None and smooth is not chosen:
        sentences.append(
            f"For soft edges take {smooth.name}: {smooth.record.tones} tones instead of {chosen.record.tones}, at "
            f"{_percent(smooth.error)} error, {bytes_text(smooth.record.map_bytes)} and {smooth.total_ms:.1f} ms."
        )
    lighter = [one for one in mapped if one.record.map_bytes < chosen.record.map_bytes]
    if lighter:
        small = min(lighter, key=lambda one: one.error)
        sentences.append(
            f"With less memory the best is {small.name}: {bytes_text(small.record.map_bytes)} "
            f"at {_percent(small.error)} error."
        )
    if fastest is not chosen:
        sentences.append(
            f"The fastest is {fastest.name}: {fastest.total_ms:.1f} ms for maps and picture against "
            f"{chosen.total_ms:.1f} ms, at {_percent(fastest.error)} error."
        )
    lit, dark = chosen.record.false_lit, chosen.record.false_shadow
    if max(lit, dark) > 2 * min(lit, dark):
        kind = "light where there should be shadow" if lit > dark else "shadow where there should be light"
        sentences.append(
            f"The errors of {chosen.record.technique} lean to one side: {kind} "
            f"({_percent(lit)} false light, {_percent(dark)} false shadow)."
        )
    return tuple(sentences)


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f} %"


def bytes_text(count: int) -> str:
    """A number of bytes for people: B, KiB or MiB."""
    if count < 1024:
        return f"{count} B"
    return f"{count / 1024:.0f} KiB" if count < 1024**2 else f"{count / 1024**2:.2f} MiB"

"""The advisor's rule, on records made by hand."""

import dataclasses

from shadowjax.evaluate.records import Record
from shadowjax.report.advisor import Choice, advise, bytes_text, pareto_front

BASE = Record("hard", 0.1, 0.01, 0.005, 0.005, 2, 2, 4096, 1.0, 1.0, 20.0, None, 0.5, 0.1)


def choice(name, error, size, milliseconds, resolution=32, **more):
    record = dataclasses.replace(
        BASE, technique=name, light_rmse=error, map_bytes=size, build_ms=0.0, visibility_ms=milliseconds, **more
    )
    return Choice(resolution, record)


def test_the_lightest_of_those_as_good_as_the_best_wins():
    best, near_best, cheap = choice("a", 0.100, 300, 1), choice("b", 0.109, 200, 9), choice("c", 0.111, 100, 1)
    advice = advise([best, near_best, cheap])
    assert advice.recommended is near_best
    assert advice.most_accurate is best
    assert advice.fastest is best


def test_time_decides_between_equals():
    slow, fast = choice("a", 0.1, 100, 5), choice("b", 0.1, 100, 4)
    assert advise([slow, fast]).recommended is fast


def test_what_stores_no_map_is_left_aside():
    exact = choice("exact", 0.0, 0, 1)
    assert advise([exact]) is None
    assert advise([exact, choice("hard", 0.1, 10, 1)]).recommended.record.technique == "hard"


def test_the_front_holds_what_nothing_beats():
    a, b = choice("a", 0.1, 100, 5), choice("b", 0.2, 50, 5)
    beaten, same = choice("c", 0.2, 100, 5), choice("d", 0.1, 100, 5)
    assert pareto_front([a, b, beaten, same]) == ("a at 32²", "b at 32²", "d at 32²")


def test_soft_edges_need_tones():
    hard, soft, heavy = (
        choice("hard", 0.1, 100, 1),
        choice("a", 0.2, 100, 1, tones=10),
        choice("b", 0.19, 200, 1, tones=9),
    )
    assert advise([hard, soft, heavy]).smooth is soft
    assert advise([hard, soft, heavy]).recommended is hard
    assert advise([hard]).smooth is None


def test_reasons_give_the_numbers():
    hard = choice("hard", 0.1, 100, 2, false_lit=0.02, false_shadow=0.001)
    soft, small = choice("pcf", 0.2, 100, 3, tones=10), choice("hard", 0.4, 25, 1, resolution=16)
    text = " ".join(advise([hard, soft, small]).reasons)
    for part in (
        "3 combinations", "is 10.00 % (hard at 32²); 1 stay within 10 %", "take pcf at 32²: 10 tones instead of 2",
        "best is hard at 16²: 25 B at 40.00 % error", "fastest is hard at 16²: 1.0 ms",
        "light where there should be shadow (2.00 % false light, 0.10 % false shadow)",
    ):  # fmt: skip
        assert part in text


def test_bytes_for_people():
    assert [bytes_text(n) for n in (12, 2048, 3 * 1024**2 // 2)] == ["12 B", "2 KiB", "1.50 MiB"]

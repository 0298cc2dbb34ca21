"""Random calls of the command line: any command, options with good, extreme and wrong values, files of every kind."""

import dataclasses
import random
import typing
from pathlib import Path

from shadowjax.cli.main import COMMANDS
from shadowjax.cli.options import limits_of

BOX = "v 0 0 0\nv 2 0 0\nv 2 0 2\nv 0 0 2\nv 1 1.5 1\nf 2 1 5\nf 3 2 5\nf 4 3 5\nf 1 4 5\n"
FILES = {
    "good.obj": BOX.encode(),
    "a\x1b[31m [red]$x$<b>.obj": BOX.encode(),
    "flat.obj": b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n",
    "nan.obj": b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "huge.obj": b"v 1e38 0 0\nv -1e38 0 0\nv 0 1e38 0\nf 1 2 3\n",
    "empty.obj": b"",
    "points.obj": b"v 0 0 0\nv 1 0 0\n",
    "index.obj": b"v 0 0 0\nv 1 0 0\nf 1 2 9\n",
    "rubbish.glb": bytes(range(256)) * 4,
    "rubbish.stl": b"solid x\nfacet",
    "rubbish.ply": b"ply\nformat ascii 1.0\nelement vertex 99999999999\n",
    "strange.zzz": b"x",
    "good.toml": b"near = 2\nfar = 50.0\n[quick]\nfar = 3\n",
    "sizes.toml": b"width = 16\nheight = 12\nresolution = 16\n",
    "large.toml": b"width = 99999999999999999999\n",
    "flag.toml": b"technique = '--help'\n",
    "wrong.toml": b"near = = 1\n",
    "bytes.toml": b"\xff\xfe\x00",
    "deep.toml": b"near = " + b"[" * 4000,
}
PATHS = [
    "new.png", "new.json", "deep/er/new.png", "old.png", "link.png", "folder", "good.obj/below.png",
    "x" * 300 + ".png", "", "a\nb\x1b[2J.png", "picture.jpg", "/dev/null", "/dev/full", "/dev/stdout", "circle",
    "locked/new.png", ".", "..",
]  # fmt: skip
TECHNIQUES = ["hard", "pcf-3x3", "exact", "vsm", "2sm-max", "preset:three-js", "z2+lispsm+3sm+pcf-2x2", "own=faces"]
SCENES = ["plate-over-plane", "two-plates", "sphere-over-plane", "cubes", "good.obj", "a\x1b[31m [red]$x$<b>.obj"]
WRONG = ["", "-", "--", "nonsense", "[/red]", "\x1b[31m", "\udcff", "-1", "1e400", "x" * 5000, "None", "汉", "0"]
WEIGHTS = {"render": 9, "report": 1, "optimize bias": 1, "optimize exponent": 1, "optimize taps": 1}  # 3 by default
SMALL = {
    "width": [16, 24], "height": [12], "resolution": [16, 24], "samples": [1, 2], "num_partitions": [1, 2, 4],
    "blur": [3], "evaluations": [2], "steps": [2], "num_depths": [2, 3], "kernel_size": [1, 2], "num_triangles": [None],
    "near": [0.5, 1.0], "far": [40.0, 100.0], "phi_deg": [20.0, 30.0], "gamma_deg": [60.0, 90.0], "seam_limit": [2.0],
    "light_azimuth_deg": [30.0], "light_elevation_deg": [50.0],
}  # fmt: skip


def make_files(folder: Path) -> None:
    """What the calls find in their folder."""
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    (folder / "folder").mkdir()
    (folder / "folder.obj").mkdir()
    (folder / "old.png").write_bytes(b"old")
    (folder / "link.png").symlink_to("old.png")
    (folder / "circle").symlink_to("circle")
    (folder / "locked").mkdir(mode=0o500)


def random_call(seed: int, cheap: bool = False) -> list[str]:
    """Words after the program's name; the same for the same seed.

    Args:
        seed: Any number.
        cheap: Whether commands that draw are given something that they refuse.
    """
    chance = random.Random(seed)
    name = chance.choice([name for name in COMMANDS for _ in range(WEIGHTS.get(name, 3))])
    draws = name in ("report", "render", "compare") or name.split()[-1] in ("bias", "exponent", "taps")
    wrong = 0.0 if chance.random() < 0.4 else 0.25
    words = name.split() + _options(chance, COMMANDS[name], wrong)
    if draws and cheap:
        words += ["--width", chance.choice(["0", "99999999999999999999", "1e3"])]
    elif draws:  # small, whatever was chosen before; a wrong value may still follow
        words += ["--width", "16", "--height", "12", "--resolution", "16"]
        if name in ("report", "compare"):
            words += ["--techniques", *chance.sample(TECHNIQUES[:3], 2)]
        if name == "report":
            words += ["--equations", "none", "--no-sweep"]
    if name == "verify":
        words += ["--only", chance.choice(["asm", "asm.cost", "mdsm.Eq5.1"])]
    for _ in range(chance.choice([0, 0, 0, 0, 1, 2])):
        _mutate(chance, words)
    return words


def _options(chance: random.Random, command: type, wrong: float) -> list[str]:
    """Some of a command's options, each with a wrong value at a given rate."""
    words: list[str] = []
    hints, limits = typing.get_type_hints(command), limits_of(command)
    for item in dataclasses.fields(command):
        hint = hints[item.name]
        if dataclasses.is_dataclass(hint):
            words += _options(chance, typing.cast(type, hint), wrong)
            continue
        must = item.name in ("output", "scene", "out")
        if not must and chance.random() > 0.2:
            continue
        flag = [] if item.name in ("scene", "name", "names") else ["--" + item.name.replace("_", "-")]
        if hint is bool:
            words.append(chance.choice([flag[0], flag[0].replace("--", "--no-", 1)]))
        else:
            words += flag + _value(chance, item.name, hint, limits.get(item.name), wrong)
    return words


def _value(chance: random.Random, name: str, hint: typing.Any, limits: typing.Any, wrong: float) -> list[str]:
    bad = chance.random() < wrong
    if name in ("json", "pareto", "output", "out"):
        usual = {"json": ["new.json", "-"], "out": ["new", "."]}.get(name, ["new.png", "deep/er/new.png", "link.png"])
        return [chance.choice(PATHS if bad else usual)]
    if name == "light":
        return [chance.choice([*WRONG, "bogus"] if bad else ["directional", "spot", "point"])]
    if name == "config":
        return [chance.choice([*FILES, "missing.toml"] if bad else ["good.toml", "sizes.toml"])]
    if name == "scene":
        return [chance.choice([*FILES, "folder.obj", "missing.obj", "cubez", "/dev/null", *WRONG] if bad else SCENES)]
    if name in (
        "technique",
        "techniques",
        "names",
        "objective",
        "caster",
        "name",
        "only",
        "equations",
        "scenes",
        "test_scenes",
    ):
        usual = {"caster": ["brute", "grid", "bvh"], "name": ["filament", "bevy"], "only": ["asm"]}.get(
            name, TECHNIQUES
        )
        usual = {
            "objective": ["z", "max", "light"],
            "equations": ["none", "asm"],
            "scenes": SCENES,
            "test_scenes": ["comb", "solids"],
        }.get(name, usual)
        return [chance.choice(WRONG if bad else usual)]
    choices = [one for one in typing.get_args(hint) if isinstance(one, str)]
    if choices:
        return [chance.choice([*WRONG, "bogus"] if bad else choices)]
    count = 3 if "tuple" in str(hint) else 1
    if bad:
        edges = [limits.low, limits.high, limits.low - 1, 10 * limits.high, "nan", "inf", "-0.0"] if limits else []
        return [str(chance.choice([*edges, *WRONG])) for _ in range(chance.choice([count, count, count + 1]))]
    if count == 3:
        return [f"{chance.uniform(-5, 5):.3f}" for _ in range(3)]
    return [str(chance.choice(SMALL[name]) or 1500)]


def _mutate(chance: random.Random, words: list[str]) -> None:
    """Change a command line as a slip of the hand does."""
    at = chance.randrange(len(words) + 1)
    kind = chance.randrange(6)
    if kind == 0 and len(words) > 1:
        del words[min(at, len(words) - 1)]
    elif kind == 1:
        words.insert(at, chance.choice(WRONG))
    elif kind == 2:
        words.insert(
            at, chance.choice(["--bogus", "-x", "--widht", "--help", "-h", "--version", "--width=16", "--near"])
        )
    elif kind == 3 and at < len(words):
        words.insert(at, words[at])
    elif kind == 4 and at < len(words):
        words[at] = words[at][: len(words[at]) // 2]
    else:
        chance.shuffle(words)

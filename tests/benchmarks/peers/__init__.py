"""The peers by name; each is imported only when it is asked for, and may be absent."""

from collections.abc import Callable, Iterable
from importlib import import_module

from tests.benchmarks.peers.base import Absent, Contestant

PEERS: dict[str, str] = {
    "Mitsuba LLVM": "mitsuba_llvm:MitsubaLLVM",
    "Mitsuba LLVM, no hint": "mitsuba_llvm:MitsubaLLVMDefault",
    "Open3D": "open3d_scene:Open3DScene",
    "embreex": "embreex_raw:EmbreexRaw",
    "trimesh + embreex": "trimesh_embreex:TrimeshEmbreex",
    "llvmpipe": "llvmpipe:Llvmpipe",
    "llvmpipe + read-back": "llvmpipe:LlvmpipeReadback",
}
# Those that the tests' own requirements bring along.
ALWAYS = ("embreex", "trimesh + embreex")


def start(names: Iterable[str]) -> tuple[list[Contestant], dict[str, str]]:
    """The peers that run here, and why the others do not."""
    present, absent = [], {}
    for name in names:
        module, kind = PEERS[name].split(":")
        try:
            make: Callable[[], Contestant] = getattr(import_module(f"{__name__}.{module}"), kind)
            contestant = make()
            contestant.version()
        except (Absent, ImportError, OSError) as error:
            absent[name] = str(error).splitlines()[0]
        else:
            present.append(contestant)
    return present, absent

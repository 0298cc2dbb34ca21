"""Prints the lowest versions that pyproject.toml allows, as constraints for pip: `make lowest` installs these."""

import re
import sys
import tomllib
from pathlib import Path

EXTRAS = ("meshes",)


def lowest(extras: tuple[str, ...] = EXTRAS) -> list[str]:
    """One line `name==version` for each dependency of the package and of these extras."""
    project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["dependencies"] + [one for extra in extras for one in project["optional-dependencies"][extra]]
    lines = []
    for requirement in wanted:
        bound = re.fullmatch(r"([\w.-]+)>=([\w.]+)", requirement)
        if bound is None:
            sys.exit(f"pyproject.toml: {requirement!r} has no lower bound; write it as name>=version")
        lines.append(f"{bound[1]}=={bound[2]}")
    return lines


if __name__ == "__main__":
    print("\n".join(lowest()))

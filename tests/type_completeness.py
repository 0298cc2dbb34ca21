"""How completely the public names are typed, as pyright counts it; fails below 95 %."""

import json
import os
import shutil
import subprocess
import sys

LEAST = 0.95


def main() -> int:
    """Print the score and what is missing; 0 where it is high enough, 2 where nothing was counted."""
    pyright = shutil.which("pyright", path=f"{sys.prefix}/bin") or "pyright"
    command = [pyright, "--verifytypes", "shadowjax", "--ignoreexternal", "--outputjson"]
    # Here pyright looks for the package in the first Python on the path, whatever its settings say.
    environment = {**os.environ, "PATH": f"{sys.prefix}/bin{os.pathsep}{os.environ.get('PATH', '')}"}
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=False, env=environment).stdout)
    found = found["typeCompleteness"]
    if not found["symbols"]:
        print(f"pyright finds no names in shadowjax, as {sys.executable} installs it; is py.typed there?")
        return 2
    score = found["completenessScore"]
    print(f"{100 * score:.1f} % of the public names are typed; at least {100 * LEAST:.0f} % are wanted")
    if score < LEAST:
        for symbol in found["symbols"]:
            for diagnostic in symbol["diagnostics"]:
                print(f"{symbol['name']}: {diagnostic['message']}")
    return int(score < LEAST)


if __name__ == "__main__":
    sys.exit(main())

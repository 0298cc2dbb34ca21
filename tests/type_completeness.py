"""How completely the public names are typed, as pyright counts it; fails below 95 %."""

import json
import shutil
import subprocess
import sys

LEAST = 0.95


def main() -> int:
    """Print the score and what is missing; 0 where it is high enough."""
    pyright = shutil.which("pyright", path=f"{sys.prefix}/bin") or "pyright"
    command = [pyright, "--verifytypes", "shadowjax", "--ignoreexternal", "--outputjson"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=False).stdout)["typeCompleteness"]
    score = found["completenessScore"]
    print(f"{100 * score:.1f} % of the public names are typed; at least {100 * LEAST:.0f} % are wanted")
    if score < LEAST:
        for symbol in found["symbols"]:
            for diagnostic in symbol["diagnostics"]:
                print(f"{symbol['name']}: {diagnostic['message']}")
    return int(score < LEAST)


if __name__ == "__main__":
    sys.exit(main())

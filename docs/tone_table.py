"""Prints the table of tones along straight edges of the page on multi-depth maps."""

from shadowjax.theory.tones import axis_step_tones, diagonal_step_tones, predicted_tones, straight_edge_tones

POLICIES = {"1-SM": 1, "2-SM max": 2, "2-SM min": 2, "3-SM min/max": 3}


def cell(num_taps: int, policy: str) -> str:
    """Tones at any angle / along an axis / at 45°, and the bound in brackets."""
    counts = [len(count(num_taps, policy)) for count in (straight_edge_tones, axis_step_tones, diagonal_step_tones)]
    return " / ".join(map(str, counts)) + f" [{predicted_tones(num_taps, POLICIES[policy])}]"


if __name__ == "__main__":
    print("| | PCF 2×2 | PCF 3×3 | PCF 4×4 |\n|---|---|---|---|")
    for name in POLICIES:
        print(f"| {name} | " + " | ".join(cell(num_taps, name) for num_taps in (4, 9, 16)) + " |")

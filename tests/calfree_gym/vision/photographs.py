"""The tracker on balls drawn before photographs.

`python -m tests.calfree_gym.vision.photographs FILE...`
"""

import sys
from pathlib import Path

import numpy as np
import PIL.Image

from tests.calfree_gym.vision.accuracy import compared
from tests.calfree_gym.vision.drawings import cut_out, drawn

FRAMES = 60


def row(name, found):
    """What became of balls, as `compared` gives it."""
    shown, hidden = found[found[:, 0] > 0.95, 1], found[found[:, 0] == 0, 1]
    seen = shown[np.isfinite(shown)]
    return (
        f"| {name} | {len(shown)} | {len(seen) / len(shown):.1%} | {np.median(seen):.2f} | "
        f"{(seen <= 1).mean():.1%} | {np.isfinite(hidden).mean():.1%} |"
    )


def main(paths):
    """Prints a table, of each photograph and of all."""
    print("| photograph | balls | found | median error, px of 512 | within 1 px | false, of hidden |")
    print("| --- | --- | --- | --- | --- | --- |")
    everything = []
    for path in paths:
        photograph = np.array(PIL.Image.open(path).convert("RGB"))
        found, _ = compared(drawn(77, FRAMES, hide=0.3, behind=cut_out(photograph)))
        everything.append(found)
        print(row(path.name, found), flush=True)
    print(row("all", np.concatenate(everything)))


if __name__ == "__main__":
    main([Path(each) for each in sys.argv[1:]])

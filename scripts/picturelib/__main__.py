"""Command line of `scripts/pictures`."""

from __future__ import annotations

import argparse
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
MOST_BYTES = 300_000


def main() -> int:
    """Make the pictures asked for; 1 where one is too large for the repository."""
    parser = argparse.ArgumentParser(prog="pictures", description="Make the pictures of the README and the pages.")
    parser.add_argument("what", nargs="?", choices=["pages", "captured"], help="both when left out")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs", help="folder; pictures go to its figures/")
    options = parser.parse_args()
    figures = options.out / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    if options.what in (None, "pages"):
        from picturelib.pages import pages

        made += pages(figures)
    if options.what in (None, "captured"):
        from picturelib.captured import captured

        made += captured(options.out)
    large = [path for path in made if path.stat().st_size > MOST_BYTES]
    print("\n".join(f"{path} {path.stat().st_size // 1000} kB" for path in made))
    for path in large:
        print(f"error: {path}: {path.stat().st_size} bytes (at most {MOST_BYTES})")
    return 1 if large else 0


if __name__ == "__main__":
    raise SystemExit(main())

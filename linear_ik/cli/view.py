"""`linear-ik view`: an element, a scan, a result, in a browser."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from linear_ik.cli.arguments import file_argument, file_option, unit_option
from linear_ik.cli.outputs import check_output
from linear_ik.cli.process import Verb
from linear_ik.cli.progress import Progress

if TYPE_CHECKING:
    from linear_ik.element import Element
    from linear_ik.viewer import Viewer

BROWSER_TIMEOUT_S = 10.0  # a browser that was closed takes some seconds to come
# A result starts with its schema; a scan in JSON does not exist.
HEAD_BYTES = 4096
EXAMPLE = """Example: what was designed, scanned and found; a page to send to somebody

\b
  linear-ik view beam.yaml scan.ply result.json
  linear-ik view scan.ply result.json --html beam.html
"""


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command("view", cls=Verb, help="Show an element, a scan and a result in a browser.", epilog=EXAMPLE)(view)


def view(
    files: Annotated[list[Path], file_argument("FILE", "Element, scan files, result: any of them.")],
    html: Annotated[
        Path | None,
        file_option("--html", metavar="PAGE.html", about="Write one self-contained page, serve nothing."),
    ] = None,
    scan_unit: Annotated[str | None, unit_option()] = None,
    port: Annotated[int | None, typer.Option("--port", min=1, max=65535, help="The first free from 7000 on.")] = None,
    wait: Annotated[bool, typer.Option("--wait/--no-wait", help="Stay until Enter or Ctrl-C, or end at once.")] = True,
) -> None:
    """Read what the files are, show them together."""
    from linear_ik.errors import LinearIkError

    target = check_output(html, files) if html else None
    kinds: dict[str, list[Path]] = {"element": [], "result": [], "scan": []}
    for path in files:
        kinds[kind_of(path)].append(path)
    for kind in ("element", "result"):
        if len(kinds[kind]) > 1:
            raise LinearIkError(kinds[kind][1], f"is a second {kind}", "one")

    progress = Progress()
    with progress.stage("reading", judges_input=True):
        from linear_ik.element_file import load_element
        from linear_ik.readers.result_json import read_result

        result = read_result(kinds["result"][0]) if kinds["result"] else None
        element = load_element(kinds["element"][0]) if kinds["element"] else None
        if result is not None and element is not None:
            check_same(kinds["result"][0], result.element, kinds["element"][0], element)
        scan = None
        if kinds["scan"]:
            from linear_ik.readers import read_scan

            scan = read_scan(*kinds["scan"], unit=scan_unit)
    with progress.stage("drawing"):
        from linear_ik.viewer import Viewer

        viewer = Viewer(result.element.name if result else element.name if element else kinds["scan"][0].name)
        if result is not None:
            viewer.show_result(result, scan)
        if element is not None:
            viewer.show_design(element)
        if scan is not None and result is None:
            viewer.show_scan(scan)
        if target is not None:
            viewer.static_html(target)
            return
    open_browser(viewer, port, wait)
    stay(viewer, wait)


def check_same(path: Path, fitted: Element, file: Path, element: Element) -> None:
    """Raise LinearIkError about a result that is of another element than the one shown with it."""
    from linear_ik.errors import LinearIkError

    for name in ("name", "profile", "profile_end", "length_m", "placement", "axis_points"):
        mine, theirs = getattr(fitted, name), getattr(element, name)
        if mine != theirs:
            called = name.removesuffix("_m")
            shown = f": {mine!r}, not {theirs!r}" if isinstance(mine, (str, float)) else ""
            raise LinearIkError(path, f"is of another element: {called}{shown}", f"a result of {file}")


def kind_of(path: Path) -> str:
    """Say whether a file is an element, a result or a scan: by its extension, JSON by its content."""
    extension = path.suffix.lower()
    if extension in (".yaml", ".yml"):
        return "element"
    if extension != ".json":
        return "scan"
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        head = b""
    return "result" if b'"schema"' in head else "element"


def open_browser(viewer: Viewer, port: int | None, wait: bool) -> bool:
    """Serve, say where, and open a browser where there is one; say whether it came."""
    from linear_ik.errors import LinearIkError

    try:
        url = viewer.serve(port)
    except OSError as error:
        raise LinearIkError("--port", f"{port}: {error.strerror or error}", "a free port") from None
    print(f"{'viewer':<11}{url}", file=sys.stderr, flush=True)
    # Without a desktop webbrowser would start a text browser in the person's terminal.
    desktop = sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if wait and desktop and sys.stderr.isatty() and webbrowser.open(url):
        return viewer.wait_for_browser(BROWSER_TIMEOUT_S)
    return False


def stay(viewer: Viewer, wait: bool) -> None:
    """Serve until Enter, Ctrl-C or the end of stdin."""
    try:
        if wait:
            print("Press Enter to end.", file=sys.stderr, flush=True)
            sys.stdin.readline(4096)
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()

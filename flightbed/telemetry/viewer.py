"""The viewer that comes with the SDK: with a window, or without one for pictures and tests; it listens to this computer alone."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from socket import create_connection, create_server
from typing import Any

from flightbed.errors import InputError, NotComputableError, OutputError
from flightbed.live import HOST
from flightbed.model_files import write_whole
from flightbed.telemetry.layout import TIMELINE

_SETTLING_S = 1.5  # for the views to draw what has arrived
_OPENING_S = 20.0  # the first time, a viewer of 280 MB comes from a cold disk


def view(path: Path) -> int:
    """Open a recording in a window; returns the viewer's exit code."""
    return subprocess.run([executable(), "--bind", HOST, "--port", "auto", str(path)], check=False).returncode


def has_display() -> bool:
    """Tell whether a window can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port() -> int:
    """Return a port of this computer that nobody listens on."""
    with closing(create_server((HOST, 0))) as server:
        return int(server.getsockname()[1])


def listens(host: str, port: int) -> bool:
    """Tell whether somebody accepts connections there."""
    with suppress(OSError), create_connection((host, port), timeout=1.0):
        return True
    return False


def url(host: str, port: int) -> str:
    """Return the address of a viewer as the SDK wants it."""
    return f"rerun+http://{f'[{host}]' if ':' in host else host}:{port}/proxy"


def executable() -> str:
    """Return the path of the viewer that belongs to the SDK. Raises NotComputableError."""
    found = importlib.util.find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise NotComputableError("the Rerun viewer is missing; install rerun-sdk again")
    return str(Path(found.origin).with_name("rerun.exe" if sys.platform == "win32" else "rerun"))


def launch(port: int, *options: str) -> subprocess.Popen[bytes]:
    """Start a viewer that listens on a port of this computer, and wait until it does.

    Raises NotComputableError when it does not get so far.
    """
    command = [executable(), "--bind", HOST, "--port", str(port), "--hide-welcome-screen", *options]
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, start_new_session=True, **quiet)  # type: ignore[call-overload]
    until = time.monotonic() + _OPENING_S
    try:
        while time.monotonic() < until and process.poll() is None:
            if listens(HOST, port):
                return process  # type: ignore[no-any-return]
            time.sleep(0.05)
    except BaseException:
        _kill(process)
        raise
    _kill(process)
    raise NotComputableError("the viewer did not open: it needs a graphics driver (in software: mesa-vulkan-drivers)")


@contextmanager
def headless(port: int | None = None) -> Iterator[Any]:
    """Give a ``rerun.experimental.ViewerClient`` of a viewer without a window, for as long as it lasts.

    Raises NotComputableError where it cannot draw.
    """
    from rerun.experimental import ViewerClient

    port = port or free_port()
    process = launch(port, "--headless")
    try:
        client = ViewerClient.connect(url(HOST, port))
        _wait_until_drawing(client, process)
        yield client
    finally:
        _kill(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()


def _wait_until_drawing(client: Any, process: subprocess.Popen[bytes]) -> None:
    """Wait for the first answer: the viewer listens before it can draw, and ends if it cannot."""
    until = time.monotonic() + _OPENING_S
    while time.monotonic() < until and process.poll() is None:
        with suppress(Exception):
            client.get_state()
            return
        time.sleep(0.05)
    raise NotComputableError(
        "the viewer cannot draw here: it needs a Vulkan driver; one in software comes with mesa-vulkan-drivers"
    )


def show_tab(client: Any, name: str) -> None:
    """Turn a viewer to a page of the layout. Raises InputError for one that there is not."""
    blueprint = client.get_blueprint("recording").blueprint
    containers = {path.strip("/"): fields.get("ContainerBlueprint", {}) for path, fields in blueprint.items()}
    inside = {str(path).strip("/") for container in containers.values() for path in container.get("contents", ())}
    top = next(container for path, container in containers.items() if container and path not in inside)
    pages = {containers[str(path).strip("/")].get("display_name", ""): path for path in top["contents"]}
    found = next((path for title, path in pages.items() if title.lower() == name.lower()), None)
    if found is None:
        raise InputError(f"--tab {name}: there is no such page; there are: {', '.join(pages)}")
    top["active_tab"] = found
    client.set_blueprint(blueprint, "recording")


def picture(recording: Path, target: Path, *, at_s: float | None = None, tab: str | None = None) -> None:
    """Write what the viewer shows of a recording as PNG, without a display.

    Args:
        recording: the .rrd file.
        target: the .png file.
        at_s: flight time that the cursor stands at; the end without.
        tab: page of the layout; the first without.

    Raises:
        InputError: a file that is not a .png, a time that the flight does not have, a page that the layout does not have.
        OutputError: the recording cannot be read, the picture not written.

    """
    if target.suffix.lower() != ".png":
        raise InputError(f"--picture {target}: must end in .png")
    if not target.parent.is_dir():
        raise OutputError(f"--picture {target}: there is no folder {target.parent}")
    with headless() as client:
        with suppress(Exception):  # it says in its own words, to nobody, what it cannot read
            client.open(str(recording.resolve()))
        timelines = [t for r in client.get_state().recordings for t in r.timelines if t.name == TIMELINE]
        if not timelines:
            raise OutputError(f"{recording}: not a recording that the viewer can read; fly the scenario again")
        end_s = timelines[0].end / 1e9
        if at_s is not None and not 0.0 <= at_s <= end_s:
            raise InputError(f"--at-s {at_s:g}: must be within the flight, 0 to {end_s:g}")
        if tab is not None:
            show_tab(client, tab)
        client.set_time(TIMELINE, duration=end_s if at_s is None else at_s, play_state="paused")
        for _ in range(3):  # it draws when asked; its own messages go after some seconds of that
            time.sleep(_SETTLING_S)
            content = client.take_screenshot()
    try:
        write_whole(target, content)
    except OutputError as error:
        raise OutputError(str(error).replace("-o ", "--picture ")) from None

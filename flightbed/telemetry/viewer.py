"""The viewer of the Rerun SDK, with a window or headless for pictures and tests; it accepts local connections only."""

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

from flightbed.core.errors import InputError, NotComputableError, OutputError
from flightbed.core.files import write_atomic
from flightbed.telemetry.layout import TIMELINE
from flightbed.telemetry.live import HOST

_SETTLING_S = 1.5  # time for the views to draw received data
_OPENING_S = 20.0  # the first start reads 280 MB from disk


def view(path: Path) -> int:
    """Open a recording in a window; return the viewer's exit code."""
    return subprocess.run([executable(), "--bind", HOST, "--port", "auto", str(path)], check=False).returncode


def has_display() -> bool:
    """Return whether the computer can open a window."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_port() -> int:
    """Return a free port of this computer."""
    with closing(create_server((HOST, 0))) as server:
        return int(server.getsockname()[1])


def listens(host: str, port: int) -> bool:
    """Return whether a process accepts connections at this address."""
    with suppress(OSError), create_connection((host, port), timeout=1.0):
        return True
    return False


def url(host: str, port: int) -> str:
    """Return the URL of a viewer in the SDK's format."""
    return f"rerun+http://{f'[{host}]' if ':' in host else host}:{port}/proxy"


def executable() -> str:
    """Return the path of the SDK's viewer. Raises NotComputableError if it is not installed."""
    found = importlib.util.find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise NotComputableError("viewer: the executable of rerun-sdk is missing; reinstall rerun-sdk")
    return str(Path(found.origin).with_name("rerun.exe" if sys.platform == "win32" else "rerun"))


def launch(port: int, *options: str) -> subprocess.Popen[bytes]:
    """Start a viewer on a port of this computer and wait until it accepts connections.

    Raises NotComputableError if it does not start within 20 s.
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
    raise NotComputableError(
        "viewer: did not start; install a graphics driver (mesa-vulkan-drivers provides a software driver)"
    )


@contextmanager
def headless(port: int | None = None) -> Iterator[Any]:
    """Yield a ``rerun.experimental.ViewerClient`` of a headless viewer; end the viewer on exit.

    Raises NotComputableError if the viewer cannot draw.
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
    """Wait for the first answer: the viewer accepts connections before it can draw, and exits without a driver."""
    until = time.monotonic() + _OPENING_S
    while time.monotonic() < until and process.poll() is None:
        with suppress(Exception):
            client.get_state()
            return
        time.sleep(0.05)
    raise NotComputableError(
        "viewer: cannot draw; install a Vulkan driver (mesa-vulkan-drivers provides a software driver)"
    )


def show_tab(client: Any, name: str) -> None:
    """Open a page of the layout in the viewer. Raises InputError for an unknown page."""
    blueprint = client.get_blueprint("recording").blueprint
    containers = {path.strip("/"): fields.get("ContainerBlueprint", {}) for path, fields in blueprint.items()}
    inside = {str(path).strip("/") for container in containers.values() for path in container.get("contents", ())}
    top = next(container for path, container in containers.items() if container and path not in inside)
    pages = {containers[str(path).strip("/")].get("display_name", ""): path for path in top["contents"]}
    found = next((path for title, path in pages.items() if title.lower() == name.lower()), None)
    if found is None:
        raise InputError(f"--tab: must be one of {', '.join(pages)} (got {name})")
    top["active_tab"] = found
    client.set_blueprint(blueprint, "recording")


def picture(recording: Path, target: Path, *, at_s: float | None = None, tab: str | None = None) -> None:
    """Write a screenshot of a recording in the viewer as PNG, without a display.

    Args:
        recording: the .rrd file.
        target: the .png file.
        at_s: flight time of the cursor, s; None for the end.
        tab: page of the layout; None for the first.

    Raises:
        InputError: a suffix other than .png, a time outside the flight, or an unknown page.
        OutputError: the recording cannot be read or the picture cannot be written.
        NotComputableError: the viewer cannot start or draw.

    """
    if target.suffix.lower() != ".png":
        raise InputError(f"--picture {target}: must end in .png")
    if not target.parent.is_dir():
        raise OutputError(f"--picture {target}: folder {target.parent} does not exist; create it first")
    with headless() as client:
        with suppress(Exception):  # an unreadable recording shows as a missing timeline below
            client.open(str(recording.resolve()))
        timelines = [t for r in client.get_state().recordings for t in r.timelines if t.name == TIMELINE]
        if not timelines:
            raise OutputError(f"{recording}: the viewer cannot read this recording; fly the scenario again")
        end_s = timelines[0].end / 1e9
        if at_s is not None and not 0.0 <= at_s <= end_s:
            raise InputError(f"--at-s {at_s:g}: must be within the flight, 0 to {end_s:g}")
        if tab is not None:
            show_tab(client, tab)
        client.set_time(TIMELINE, duration=end_s if at_s is None else at_s, play_state="paused")
        for _ in range(3):  # the viewer draws on request; its notifications disappear after some seconds
            time.sleep(_SETTLING_S)
            content = client.take_screenshot()
    try:
        write_atomic(target, content)
    except OutputError as error:
        raise OutputError(str(error).replace("-o ", "--picture ")) from None

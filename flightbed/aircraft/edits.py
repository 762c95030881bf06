"""Edits of an overlay to a stock JSBSim model; each raises EditError if the model does not have the expected elements."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from string import Template
from typing import Any

from flightbed.core.errors import did_you_mean

_TAGS = re.compile(r"[A-Za-z_][\w.-]*(/[A-Za-z_][\w.-]*)*(/\*)?")


class EditError(Exception):
    """The stock model does not have the elements that an edit refers to."""


def substitute(edit: Mapping[str, Any], fill: Mapping[str, str]) -> dict[str, Any]:
    """Return an edit with ``$names`` substituted in its texts."""
    return {key: Template(value).substitute(fill) if isinstance(value, str) else value for key, value in edit.items()}


def _section(root: ET.Element, tag: str) -> ET.Element:
    section = root.find(tag)
    if section is None:
        raise EditError(f"the stock model has no <{tag}>")
    return section


def _declare(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    element = ET.Element("property", value=str(edit["value"]))
    element.text = edit["property"]
    _section(root, "flight_control").insert(0, element)


def _channel(root: ET.Element, name: str) -> tuple[ET.Element, int]:
    control = _section(root, "flight_control")
    places = [i for i, c in enumerate(control) if c.tag == "channel" and c.get("name") == name]
    if len(places) != 1:
        raise EditError(f"expected one channel {name}, found {len(places)}")
    return control, places[0]


def _replace_channel(root: ET.Element, edit: Mapping[str, Any], snippets: Mapping[str, str]) -> None:
    control, place = _channel(root, edit["channel"])
    control[place] = ET.fromstring(snippets[edit["with"]])  # in place: channels run in file order


def _insert_channel(root: ET.Element, edit: Mapping[str, Any], snippets: Mapping[str, str]) -> None:
    control, place = _channel(root, edit["before"])
    control.insert(place, ET.fromstring(snippets[edit["with"]]))


def _rewire_channel(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    control, place = _channel(root, edit["channel"])
    hits = [
        e for e in control[place].iter() if (e.text or "").strip() == edit["from"] or e.get("value") == edit["from"]
    ]
    if len(hits) != edit["count"]:
        raise EditError(
            f"expected {edit['from']} {edit['count']} times in channel {edit['channel']}, found {len(hits)}"
        )
    for element in hits:
        if element.get("value") == edit["from"]:
            element.set("value", edit["to"])
        else:
            element.text = edit["to"]


def _rewire(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    """Make aerodynamic functions read other properties; ``to`` must list all functions that read ``from``, by new property."""
    if not isinstance(edit["to"], Mapping):
        raise EditError('to: must list the functions of each new property: to."fcs/new" = ["aero/coefficient/NAME"]')
    targets = [(function, to) for to, functions in edit["to"].items() for function in functions]
    readers = [
        (str(function.get("name")), element)
        for function in _section(root, "aerodynamics").iter("function")
        for element in function.iter()
        if (element.text or "").strip() == edit["from"]
    ]
    found, expected = sorted(name for name, _ in readers), sorted(name for name, _ in targets)
    if found != expected:
        raise EditError(f"expected {edit['from']} in {expected}, found it in {found}")
    for name, element in readers:
        element.text = dict(targets)[name]


def _remove_functions(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    wanted = set(edit["functions"])
    for axis in _section(root, "aerodynamics").iter("axis"):
        for function in [f for f in axis.findall("function") if f.get("name") in wanted]:
            axis.remove(function)
            wanted.discard(str(function.get("name")))
    if wanted:
        raise EditError(f"no function {', '.join(sorted(wanted))}")


def _remove_systems(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    wanted = set(edit["systems"])
    for system in [s for s in root.findall("system") if s.get("file") in wanted]:
        root.remove(system)
        wanted.discard(str(system.get("file")))
    if wanted:
        raise EditError(f"no system {', '.join(sorted(wanted))}")


def _remove(root: ET.Element, edit: Mapping[str, Any], _snippets: Mapping[str, str]) -> None:
    """Remove the elements at a path of tags: one of each of ``names``, or all, which must be ``count``.

    A path is ``"flight_control/channel"``, or ``"flight_control/channel/*"`` for elements with any tag.
    """
    path, names, count = edit["elements"], edit.get("names"), edit.get("count")
    if not isinstance(path, str) or not _TAGS.fullmatch(path):
        raise EditError(f'elements: must be tags from the root, "flight_control/channel" (got {path!r})')
    if (names is None) == (count is None):
        raise EditError(f"{path}: needs either names or count (got {'neither' if names is None else 'both'})")
    *above, tag = path.split("/")
    parents = [root]
    for step in above:
        parents = [child for parent in parents for child in parent if child.tag == step]
    found = [(parent, child) for parent in parents for child in parent if tag in (child.tag, "*")]
    if names is None:
        if not isinstance(count, int) or isinstance(count, bool) or count < 1:
            raise EditError(f"{path}: count: must be a whole number of at least 1 (got {count!r})")
        if len(found) != count:
            raise EditError(f"expected {count} times {path}, found {len(found)}; correct elements or count")
    else:
        if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
            raise EditError(f"{path}: names: must be a list of texts (got {names!r})")
        there = [child.get("name", "") for _, child in found]
        for name in names:
            if (times := there.count(name)) != 1:
                cure = (did_you_mean(name, there) if times == 0 else "") or "; correct elements or names"
                raise EditError(f"expected one {path} named {name}, found {times}{cure}")
        found = [(parent, child) for parent, child in found if child.get("name") in names]
    for parent, child in found:
        parent.remove(child)


EDITS = {
    "declare": _declare,
    "replace-channel": _replace_channel,
    "insert-channel": _insert_channel,
    "rewire-channel": _rewire_channel,
    "rewire": _rewire,
    "remove-functions": _remove_functions,
    "remove-systems": _remove_systems,
    "remove": _remove,
}

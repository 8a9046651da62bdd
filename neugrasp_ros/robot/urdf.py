# SPDX-License-Identifier: Apache-2.0
"""The robot's URDF, changed in memory: hands off, grippers and named frames on."""

import os
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

from neugrasp_ros.errors import ConfigError, RobotModelError
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.robot.description import Placement, RobotDescription

Element = ElementTree.Element

FINGER_MASS = 0.05  # [kg]
CARRIAGE_MASS = 0.05  # [kg], carries the fingers
CARRIAGE_FORCE = 500.0  # [N]; a linkage does not give way
PALM_MASS = 0.9  # [kg]; with the fingers 1.05 kg, a 2F-85


def finger_joints(key: str) -> tuple[str, str]:
    """Return the joints that we add to a mounted gripper: left (+y), right (-y).

    Each is prismatic and counts from the closed jaws, in [m].
    """
    return f"gripper_{key}_left_slide_joint", f"gripper_{key}_right_slide_joint"


def advance_joint(key: str) -> str:
    """Return the joint that carries both fingers ahead while the jaws close, in [m].

    A linkage swings its pads; nobody commands this joint, it follows the jaws.
    """
    return f"gripper_{key}_advance_joint"


def derive_urdf(description: RobotDescription) -> str:
    """Return the robot as one URDF text, for this process only.

    Links of ``remove_links`` are gone with their subtrees; every mounted gripper is
    there as three boxes with prismatic joints, and its frame
    ``gripper_<key>_tcp``; added frames are links without geometry; mesh file names
    are absolute. The text must not be stored in a place that is published: the
    licence of the original holds for it.

    Raises:
        RobotModelError: If a link that is named in the description does not exist.
        ConfigError: If a mesh cannot be found.
    """
    robot = ElementTree.parse(description.urdf).getroot()
    for tag in ("gazebo", "transmission"):
        for element in robot.findall(tag):
            robot.remove(element)
    for link in description.remove_links:
        _require_link(robot, link)
        _remove_subtree(robot, link)
    for key, mount in description.grippers.items():
        _require_link(robot, mount.placement.parent)
        _add_gripper(robot, key, load_gripper(mount.gripper), mount.placement)
    for name, placement in description.frames.items():
        _require_link(robot, placement.parent)
        _add_link(robot, name)
        _add_joint(robot, f"{name}_joint", name, placement)
    _make_mesh_paths_absolute(robot, description.urdf)
    return ElementTree.tostring(robot, encoding="unicode")


def _require_link(robot: Element, name: str) -> None:
    names = [link.get("name", "") for link in robot.findall("link")]
    if name not in names:
        raise RobotModelError("link", name, names)


def _remove_subtree(robot: Element, root: str) -> None:
    doomed = {root}
    joints = robot.findall("joint")
    before = 0
    while len(doomed) > before:
        before = len(doomed)
        doomed |= {
            _end(joint, "child") for joint in joints if _end(joint, "parent") in doomed
        }
    for joint in joints:
        if _end(joint, "child") in doomed:
            robot.remove(joint)
    for link in robot.findall("link"):
        if link.get("name") in doomed:
            robot.remove(link)


def _end(joint: Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _add_gripper(robot: Element, key: str, gripper: Gripper, at: Placement) -> None:
    """Add base, fingers and TCP; link axes are those of the mounting face."""
    base, tcp = f"gripper_{key}_base_link", f"gripper_{key}_tcp"
    centers, halves = gripper.boxes(0.0)  # gripper frame: z approach, y closing
    boxes = [
        ((c[2] + gripper.mount_to_tcp, c[1], -c[0]), (2 * h[2], 2 * h[1], 2 * h[0]))
        for c, h in zip(centers, halves, strict=True)
    ]
    palm = _add_link(robot, base, PALM_MASS)
    _add_box(palm, *boxes[2])
    gap = boxes[2][0][0] - boxes[2][1][0] / 2  # mounting face to palm: the coupling
    if gap > 0:
        _add_box(palm, (gap / 2, 0.0, 0.0), (gap, *boxes[2][1][2:], boxes[2][1][2]))
    _add_joint(robot, f"gripper_{key}_mount_joint", base, at)
    _add_link(robot, tcp)
    ahead = Placement(parent=base, xyz=(gripper.mount_to_tcp, 0.0, 0.0))
    _add_joint(robot, f"{tcp}_joint", tcp, ahead)
    carrier, name = f"gripper_{key}_carriage_link", advance_joint(key)
    _add_link(robot, carrier, CARRIAGE_MASS)
    joint = _add_joint(robot, name, carrier, Placement(parent=base), "prismatic")
    _limit(joint, "1 0 0", gripper.tip_advance, CARRIAGE_FORCE)
    for side, name, (center, size) in zip(
        (1, -1), finger_joints(key), boxes[:2], strict=True
    ):
        finger = name.replace("_slide_joint", "_finger_link")
        _add_box(_add_link(robot, finger, FINGER_MASS), center, size)
        joint = _add_joint(robot, name, finger, Placement(parent=carrier), "prismatic")
        _limit(joint, f"0 {side} 0", gripper.max_opening / 2, gripper.max_force)


def _limit(joint: Element, axis: str, travel: float, effort: float) -> None:
    ElementTree.SubElement(joint, "axis", xyz=axis)
    ElementTree.SubElement(
        joint,
        "limit",
        lower="0",
        upper=repr(travel),
        velocity="0.15",
        effort=repr(effort),
    )


def _add_link(robot: Element, name: str, mass: float = 0.0) -> Element:
    link = ElementTree.SubElement(robot, "link", name=name)
    if mass:
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "mass", value=repr(mass))
        moment = repr(mass * 0.03**2)  # radius of gyration 3 cm
        zero = {"ixy": "0", "ixz": "0", "iyz": "0"}
        ElementTree.SubElement(
            inertial, "inertia", {"ixx": moment, "iyy": moment, "izz": moment, **zero}
        )
    return link


def _add_box(link: Element, center: Iterable[float], size: Iterable[float]) -> None:
    for tag in ("visual", "collision"):
        part = ElementTree.SubElement(link, tag)
        ElementTree.SubElement(part, "origin", xyz=_text(center), rpy="0 0 0")
        geometry = ElementTree.SubElement(part, "geometry")
        ElementTree.SubElement(geometry, "box", size=_text(size))


def _add_joint(
    robot: Element, name: str, child: str, at: Placement, kind: str = "fixed"
) -> Element:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=at.parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=_text(at.xyz), rpy=_text(at.rpy))
    return joint


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _make_mesh_paths_absolute(robot: Element, urdf: Path) -> None:
    cache: dict[str, str] = {}
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        if name not in cache:
            cache[name] = str(_find_mesh(name, urdf))
        mesh.set("filename", cache[name])


def _find_mesh(name: str, urdf: Path) -> Path:
    if not name.startswith("package://"):
        path = urdf.parent / name.removeprefix("file://")
        if path.is_file():
            return path.resolve()
        raise ConfigError(f"{urdf.name}: no mesh at {path}")
    relative = name.removeprefix("package://")
    package, _, inside = relative.partition("/")
    roots = [parent.parent for parent in urdf.parents if parent.name == package]
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            roots += [Path(prefix), Path(prefix) / "share"]
    for root in roots:
        if (root / package / inside).is_file():
            return root / package / inside
    raise ConfigError(
        f"{urdf.name}: no mesh {name}; looked in {[str(root) for root in roots]} "
        "(set ROS_PACKAGE_PATH)"
    )

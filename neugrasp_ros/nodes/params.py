# SPDX-License-Identifier: Apache-2.0
"""Configuration dataclasses as ROS parameters: described, ranged, validated live."""

from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from neugrasp_ros.errors import ConfigError

Config = TypeVar("Config")


def fixed(item: Any) -> Any:
    """Mark an ``option`` of a node's configuration as read-only after start."""
    if not isinstance(item, Field):
        raise ConfigError(f"expected a dataclass field, got {item!r}")
    metadata = {**item.metadata, "read_only": True}
    return field(
        default=item.default, default_factory=item.default_factory, metadata=metadata
    )


@dataclass(frozen=True, slots=True)
class _Entry:
    """A leaf field: its ROS name, its path through nested dataclasses, itself."""

    path: tuple[str, ...]
    item: Any
    default: Any

    @property
    def name(self) -> str:
        return ".".join(self.path)


class LiveConfig(Generic[Config]):
    """A configuration that follows its node's parameters.

    Attributes:
        current: The configuration now; replaced as a whole when a parameter is set.
    """

    def __init__(self, config: Config) -> None:
        self.current = config


def declare_config(
    node: Node, config_type: type[Config], *, read_only: bool = False
) -> LiveConfig[Config]:
    """Declare one parameter per field and read back the overrides of the launch.

    Fields of nested dataclasses get dotted names, such as ``workspace.origin``.
    Integers given for a double are widened. A later ``set_parameters`` is checked by
    the dataclass itself before it is taken.

    Args:
        node: Node that will own the parameters.
        config_type: Dataclass whose fields all have a default and a ``doc``.
        read_only: Make all of them read-only, not only those marked ``fixed``.

    Returns:
        Holder of the validated configuration.

    Raises:
        ConfigError: If an override is out of range or of the wrong type.
    """
    defaults = config_type()
    entries = _leaves(config_type, defaults, ())
    values = {e.path: _declare(node, e, read_only) for e in entries}
    live = LiveConfig(_rebuild(defaults, values))
    by_name = {entry.name: entry for entry in entries}

    def widen(parameters: list[Parameter]) -> list[Parameter]:
        return [_widened(by_name.get(p.name), p) for p in parameters]

    def check(parameters: list[Parameter]) -> SetParametersResult:
        try:
            _changed(live.current, by_name, parameters)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters: list[Parameter]) -> None:
        live.current = _changed(live.current, by_name, parameters)

    node.add_pre_set_parameters_callback(widen)
    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(apply)
    return live


def _leaves(config_type: type, defaults: Any, prefix: tuple[str, ...]) -> list[_Entry]:
    entries = []
    for item in fields(config_type):
        default = getattr(defaults, item.name)
        path = (*prefix, item.name)
        if is_dataclass(default):
            entries += _leaves(type(default), default, path)
        else:
            entries.append(_Entry(path, item, default))
    return entries


def _declare(node: Node, entry: _Entry, read_only: bool) -> Any:
    """Declare one parameter; the first, untyped declaration only reads the override."""
    default = list(entry.default) if isinstance(entry.default, tuple) else entry.default
    loose = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(entry.name, default, loose).value
    node.undeclare_parameter(entry.name)
    value = _coerced(entry, given)
    try:
        node.declare_parameter(
            entry.name,
            list(value) if isinstance(value, tuple) else value,
            _descriptor(entry, read_only),
            ignore_override=True,
        )
    except InvalidParameterValueException as error:
        low, high = entry.item.metadata["range"]
        raise ConfigError(
            f"{entry.name} must be in [{low}, {high}], got {value}"
        ) from error
    return value


def _coerced(entry: _Entry, value: Any) -> Any:
    """Return a parameter's value as the field's type; integers become doubles."""
    wanted = entry.default
    if isinstance(wanted, tuple):
        if not isinstance(value, (str, bytes)) and hasattr(value, "__len__"):
            same = all(_fits(wanted[0], v) for v in value)
            if same and (isinstance(wanted[0], str) or len(value) == len(wanted)):
                return tuple(type(wanted[0])(v) for v in value)
        kind = f"{len(wanted)} of {type(wanted[0]).__name__}"
    elif _fits(wanted, value):
        return type(wanted)(value)
    else:
        kind = type(wanted).__name__
    raise ConfigError(f"{entry.name} must be {kind}, got {value!r}")


def _fits(wanted: Any, value: Any) -> bool:
    if isinstance(wanted, float):
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return type(value) is type(wanted)


def _descriptor(entry: _Entry, read_only: bool) -> ParameterDescriptor:
    metadata = entry.item.metadata
    descriptor = ParameterDescriptor(
        description=metadata["doc"],
        read_only=read_only or metadata.get("read_only", False),
    )
    if metadata.get("choices"):
        descriptor.additional_constraints = "one of: " + ", ".join(metadata["choices"])
    if metadata.get("range"):
        low, high = metadata["range"]
        if isinstance(entry.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        else:
            descriptor.integer_range = [
                IntegerRange(from_value=int(low), to_value=int(high))
            ]
    return descriptor


def _widened(entry: _Entry | None, parameter: Parameter) -> Parameter:
    """Return a parameter whose integers are doubles where the field wants doubles."""
    if entry is None:
        return parameter
    try:
        value = _coerced(entry, parameter.value)
    except ConfigError:
        return parameter  # refused by the check that follows, with the reason
    return Parameter(
        parameter.name, value=list(value) if isinstance(value, tuple) else value
    )


def _changed(
    config: Config, by_name: dict[str, _Entry], parameters: list[Parameter]
) -> Config:
    known = [(by_name[p.name], p.value) for p in parameters if p.name in by_name]
    return _rebuild(config, {e.path: _coerced(e, value) for e, value in known})


def _rebuild(config: Config, values: dict[tuple[str, ...], Any]) -> Config:
    """Return ``config`` with the leaves at the given paths replaced."""
    here = {path[0]: value for path, value in values.items() if len(path) == 1}
    for name in {path[0] for path in values if len(path) > 1}:
        inner = {p[1:]: v for p, v in values.items() if p[0] == name and len(p) > 1}
        here[name] = _rebuild(getattr(config, name), inner)
    return replace(config, **here)  # type: ignore[type-var]

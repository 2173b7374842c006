"""Networks as ONNX models, written without the packages that export models, and run on one thread.

An ONNX model is a protocol buffer: fields as (number, wire type, content), integers in base 128, with length prefixes.
This module writes the few messages that a convolutional network needs, so that weights are used directly from their
file. Left out: other operators, and types other than float32.
Reference: ONNX 1.14, `onnx/onnx.proto` (IR version 8, operator set 13).

A convolution that is split over threads sums in another order, and the last bits of its result differ. Over a thousand
decisions this changes the trajectory. The networks here are too small to gain from a second thread.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float32

#: Versions that the messages and operators below are of.
IR_VERSION, OPERATOR_SET = 8, 13
#: `TensorProto.FLOAT`, and `AttributeProto.AttributeType` of what attributes hold.
_FLOAT, _INT_ATTRIBUTE, _TEXT_ATTRIBUTE, _INTS_ATTRIBUTE = 1, 2, 3, 7
#: Disables telemetry of ONNX Runtime, which would also store an identifier of the machine; read at its import.
SILENT = "ORT_DISABLE_TELEMETRY"

Attribute = int | str | Sequence[int]


class OnnxGraph:
    """Operators and weights of a model, put together one after the other."""

    def __init__(self) -> None:
        self._nodes: list[bytes] = []
        self._weights: list[bytes] = []

    def weight(self, array: Float32[np.ndarray, "..."]) -> str:
        """Add numbers that are known; the name by which operators take them."""
        name = f"w{len(self._weights)}"
        dims = b"".join(_number(1, size) for size in array.shape)
        raw = np.ascontiguousarray(array, "<f4").tobytes()
        self._weights.append(dims + _number(2, _FLOAT) + _text(8, name) + _bytes(9, raw))
        return name

    def node(self, operator: str, *inputs: str, **attributes: Attribute) -> str:
        """Add an operator; the name of what it gives."""
        name = f"n{len(self._nodes)}"
        content = (
            b"".join(_text(1, input_name) for input_name in inputs) + _text(2, name) + _text(4, operator)
        )
        content += b"".join(_bytes(5, _attribute(key, value)) for key, value in attributes.items())
        self._nodes.append(content)
        return name

    def model(self, inputs: Mapping[str, Sequence[int | str]], output: str) -> bytes:
        """The model."""
        graph = b"".join(_bytes(1, node) for node in self._nodes) + _text(2, "network")
        graph += b"".join(_bytes(5, weight) for weight in self._weights)
        graph += b"".join(_bytes(11, _array(name, shape)) for name, shape in inputs.items())
        graph += _bytes(12, _array(output, None))
        return _number(1, IR_VERSION) + _bytes(7, graph) + _bytes(8, _number(2, OPERATOR_SET))


def _attribute(name: str, value: Attribute) -> bytes:
    """AttributeProto."""
    if isinstance(value, int):
        return _text(1, name) + _number(3, value) + _number(20, _INT_ATTRIBUTE)
    if isinstance(value, str):
        return _text(1, name) + _text(4, value) + _number(20, _TEXT_ATTRIBUTE)
    return _text(1, name) + b"".join(_number(8, item) for item in value) + _number(20, _INTS_ATTRIBUTE)


def _array(name: str, shape: Sequence[int | str] | None) -> bytes:
    """ValueInfoProto of an array of float32; its shape is left to be inferred if it is not given."""
    kind = _number(1, _FLOAT)
    if shape is not None:
        sizes = (_text(2, size) if isinstance(size, str) else _number(1, size) for size in shape)
        kind += _bytes(2, b"".join(_bytes(1, size) for size in sizes))
    return _text(1, name) + _bytes(2, _bytes(1, kind))


def _text(field: int, value: str) -> bytes:
    return _bytes(field, value.encode())


def _bytes(field: int, value: bytes) -> bytes:
    return _key(field, 2) + _varint(len(value)) + value


def _number(field: int, value: int) -> bytes:
    return _key(field, 0) + _varint(value)


def _key(field: int, wire_type: int) -> bytes:
    return _varint(field << 3 | wire_type)


def _varint(value: int) -> bytes:
    """A whole number of 0 or more in base 128, lowest digits first; all but the last have their highest bit set."""
    digits = bytearray()
    while value > 0x7F:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*digits, value])


class OnnxRunner:
    """A model ready to run; a copy, or one sent to another process, creates its own session."""

    def __init__(self, model: bytes) -> None:
        """Make a model ready."""
        self._model = model
        self._session: Any = None

    def __call__(self, **inputs: Float32[np.ndarray, "..."]) -> Float32[np.ndarray, "..."]:
        """The model's output for its inputs, by name."""
        if self._session is None:
            self._session = _session(self._model)
        output: np.ndarray = self._session.run(None, inputs)[0]
        return output

    def __getstate__(self) -> dict[str, Any]:
        return {"_model": self._model, "_session": None}


def _session(model: bytes) -> Any:
    os.environ.setdefault(SILENT, "1")
    import onnxruntime  # takes a tenth of a second

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors: warnings concern devices that are not used
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

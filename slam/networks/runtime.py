"""Running a network: ONNX Runtime on one thread.

A convolution that is split over threads adds up in another order, and the last bits of its result differ. On a way of a
thousand decisions they grow to another way. The networks here are too small to gain from a second thread.

Newer versions of ONNX Runtime tell their maker what they run, and keep an identifier of the machine on disk for that.
Here they do not: nothing leaves the machine.
"""

import os
from typing import Any

import numpy as np
from jaxtyping import Float32


class OnnxRunner:
    """A model, ready to be asked; one that is copied or sent to another process is made ready there anew."""

    def __init__(self, model: bytes) -> None:
        """Make a model ready.

        Args:
            model: An ONNX model with one output.
        """
        self._model = model
        self._session: Any = None

    def __call__(self, **inputs: Float32[np.ndarray, "..."]) -> Float32[np.ndarray, "..."]:
        """The model's output for its inputs, by name."""
        if self._session is None:
            self._session = _session(self._model)
        found: np.ndarray = self._session.run(None, inputs)[0]
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {"_model": self._model, "_session": None}


#: By which ONNX Runtime is told to send nothing; it looks when it is imported. Who wants that it does sets it to 0.
SILENT = "ORT_DISABLE_TELEMETRY"


def _session(model: bytes) -> Any:
    os.environ.setdefault(SILENT, "1")
    import onnxruntime  # takes a tenth of a second

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors: warnings are about devices that are not asked for
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

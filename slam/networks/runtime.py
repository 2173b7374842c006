"""Running a network: ONNX Runtime on one thread.

A convolution that is split over threads sums in another order, and the last bits of its result differ. Over a thousand
decisions this changes the trajectory. The networks here are too small to gain from a second thread.

Newer versions of ONNX Runtime send telemetry and store an identifier of the machine on disk. It is disabled here.
"""

import os
from typing import Any

import numpy as np
from jaxtyping import Float32


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
        found: np.ndarray = self._session.run(None, inputs)[0]
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {"_model": self._model, "_session": None}


#: Disables telemetry of ONNX Runtime, which reads it at import. Set it to 0 to allow telemetry.
SILENT = "ORT_DISABLE_TELEMETRY"


def _session(model: bytes) -> Any:
    os.environ.setdefault(SILENT, "1")
    import onnxruntime  # takes a tenth of a second

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3  # errors: warnings concern devices that are not used
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

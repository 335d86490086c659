"""A policy in an ONNX file, flown by ONNX Runtime."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MISSING = 'ONNX files need ONNX Runtime: pip install "quadsafe[onnx]"'


class OnnxPolicy:
    """The network of an ONNX file: its only input are observations, its first output is the actions.

    A file made for one observation at a time is run row by row.

    Args:
        path: the file.

    Raises:
        FileNotFoundError: if there is none.
        ValueError: without ONNX Runtime, for a file that it cannot read, or one with several inputs.
    """

    def __init__(self, path: Path):
        if not path.is_file():
            raise FileNotFoundError(f"policy must be a file, got {str(path)!r}")
        self._session = _session(path)
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or len(inputs[0].shape) != 2:
            shapes = [(one.name, one.shape) for one in inputs]
            raise ValueError(f"policy must have one input of shape (N, D), got {shapes} in {path}")
        self._input, self._output = inputs[0].name, self._session.get_outputs()[0].name
        self._is_of_one = inputs[0].shape[0] == 1

    def predict(
        self, observation: NDArray, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """Actions (N, 4) for observations (N, D)."""
        rows = np.asarray(observation, dtype=np.float32)
        parts = rows[:, None] if self._is_of_one else [rows]
        return np.concatenate([self._run(part) for part in parts]), None

    def _run(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        (actions,) = self._session.run([self._output], {self._input: rows})
        return np.asarray(actions)


def _session(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise ValueError(MISSING) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # as torch: more make networks this small slower
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime has no class that all its errors have in common
        reason = str(error).partition("\n")[0]
        raise ValueError(f"{path} must be an ONNX file, got: {reason}") from error

"""The policy of a neural network that was learnt elsewhere, in a file of the format ONNX."""

from __future__ import annotations

import os
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import describe_missing_file
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, describe_error, import_extra
from shoal.swarm.grid.board import letters_of
from shoal.swarm.policies.protocol import Decision, View

if TYPE_CHECKING:
    from numpy.random import Generator

PATIENCE = 20
"""Number of commands in a row that classify no cell, after which the policy chooses at random."""

INPUTS = ("planes", "last")

RANDOM = (
    "Bernoulli",
    "Multinomial",
    "RandomNormal",
    "RandomNormalLike",
    "RandomUniform",
    "RandomUniformLike",
)
"""Operators of ONNX whose results no seed of a problem determines."""


@dataclass(frozen=True)
class Model:
    """Send the commands that a neural network rates best.

    The network gets the input ``planes``, float32, shape (1, 4, H, W): the planes "particles",
    "free", "obstacles" and "frontier" of the whole map with its rim, as the observation "planes" of
    the environments. If it has an input ``last``, float32, shape (1, 4), it also gets the last
    command: 1 for this command, and 0 for the others. Its first output has one rating for each of
    the commands l, u, r and d, in this order. The policy sends the best rated command that can have
    an effect. After `PATIENCE` commands that classified no cell, it draws from these commands, with
    chances proportional to the exponential functions of the ratings, until a cell is classified.

    Parameters
    ----------
    file : str
        Path of the file.

    Raises
    ------
    MissingExtraError
        If ``shoal[onnx]`` is not installed.
    InvalidInputError
        If the file holds no such network, or one whose ratings are random: no seed would repeat its
        run.
    """

    kind: ClassVar[str] = "model"
    rules: ClassVar[tuple[str, ...]] = ("block", "tilt")
    dimensions: ClassVar[tuple[int, ...]] = (2,)
    gathers: ClassVar[bool] = False
    file: str

    def __post_init__(self) -> None:
        for operator in RANDOM:
            if _has(self.file, _version(self.file), operator):
                raise _refusal(self.file, f"the operator {operator}, whose results are random")
        _session(self.file, _version(self.file))

    @property
    def name(self) -> str:
        """Name of the policy with its file, as written in summaries and files."""
        return f"model:{self.file}"

    def content(self) -> bytes:
        """Return the bytes of the file."""
        with open(self.file, "rb") as file:
            return file.read()

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the best rated command, and the last command and the number of commands without
        progress.
        """
        last, idle = memory or (-1, 0)
        idle = 0 if view.classified or memory is None else idle + 1
        ratings = self.rate(planes_of(view), last)
        ratings[~useful_commands(view)] = -np.inf
        if idle < PATIENCE:
            command = int(ratings.argmax())
        else:
            chances = np.exp(ratings - ratings.max())
            command = int(rng.choice(len(chances), p=chances / chances.sum()))
        return letters_of(2)[command], (command, idle)

    def rate(self, planes: NDArray[np.float32], last: int) -> NDArray[np.float64]:
        """Return the network's rating of each command; float64, shape (4,)."""
        version = _version(self.file)
        session = _session(self.file, version)
        last_command = np.zeros((1, 4), dtype=np.float32)
        if last >= 0:
            last_command[0, last] = 1
        names = {argument.name for argument in session.get_inputs()}
        values = {"planes": planes[None], "last": last_command}
        inputs = {name: values[name] for name in names}
        # a dropout is random if the network was saved as for training
        times = 2 if _has(self.file, version, "Dropout") else 1
        try:
            outputs = [session.run(None, inputs) for _ in range(times)]
            ratings = np.array(outputs[0][0], dtype=np.float64).ravel()
            again = np.array(outputs[-1][0], dtype=np.float64).ravel()
        except Exception as error:  # the library's own kinds of error
            raise _refusal(self.file, describe_error(error)) from None
        if not np.array_equal(ratings, again, equal_nan=True):
            raise _refusal(self.file, "the operator Dropout in the mode for training")
        if ratings.shape != (4,) or not np.isfinite(ratings).all():
            raise _refusal(self.file, f"ratings {ratings.tolist()!r:.60}")
        return ratings


def planes_of(view: View) -> NDArray[np.float32]:
    """Return the planes "particles", "free", "obstacles" and "frontier"; float32, shape (4, H,
    W).
    """
    belief = view.belief
    boards = (view.occupied, belief.open, belief.obstacles, belief.frontier)
    return np.stack([board.mask for board in boards]).astype(np.float32)


def useful_commands(view: View) -> NDArray[np.bool_]:
    """Return which commands can move a particle, according to the belief; all, if none can; bool,
    shape (4,).
    """
    obstacles = view.belief.obstacles
    useful = np.array(
        [
            bool(view.occupied.shifted(letter) - obstacles - view.occupied)
            for letter in letters_of(2)
        ]
    )
    return useful | ~useful.any()


def _version(file: str) -> tuple[int, int]:
    try:
        stat = os.stat(file)
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"policy model: cannot read {file!r}: {error}") from None
    if missing := describe_missing_file(file):
        raise InvalidInputError(f"policy model: expected a file, got {file}: {missing}")
    return stat.st_mtime_ns, stat.st_size


@lru_cache(maxsize=64)
def _has(file: str, version: tuple[int, int], operator: str) -> bool:
    """Return whether a network has a node of an operator, in its graph or in a graph within; see
    `_session` for ``version``.

    In the binary form of a network, the name of a node's operator (its field 4, a text) follows the
    byte 0x22 and the length of the name.
    """
    with open(file, "rb") as network:
        return bytes([0x22, len(operator)]) + operator.encode() in network.read()


@lru_cache(maxsize=8)
def _session(file: str, version: tuple[int, int]) -> Any:
    """Return the loaded network of a file; ``version`` changes when the file changes."""
    onnxruntime = import_extra("onnxruntime", "the policy model needs onnxruntime", extra="onnx")
    options = onnxruntime.SessionOptions()
    # one thread, so that workers do not compete, and sums do not depend on the machine
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(
            file, sess_options=options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # the library's own kinds of error
        raise _refusal(file, describe_error(error)) from None
    names = [argument.name for argument in session.get_inputs()]
    if "planes" not in names or not set(names) <= set(INPUTS):
        raise _refusal(file, f"the inputs {', '.join(names) or 'none'}")
    return session


def _refusal(file: str, reason: str) -> InvalidInputError:
    return InvalidInputError(
        f"policy model: expected a file with an ONNX network of the inputs planes and perhaps"
        f" last, and one rating for each of four commands, got {file}: {reason}"
    )

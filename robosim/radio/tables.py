"""Tables of radio paths of one building, made when they are first asked for, and kept.

The last ones are kept in memory, and all of them in a folder if one is given. Robots of one process share them.
"""

import hashlib
from collections import OrderedDict
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.radio.classifier import Classifier
from robosim.radio.table import STEP_M, RadioTable
from robosim.radio.table_reader import states_of
from wireless.sounding.sounder import Sounder
from wireless.tracing.tracer import Tracer

#: Tables that are kept in memory: 5 MB each in a flat, 40 MB in an office.
_KEPT = 16


class RadioTables:
    """Tables by the place of the transmitter."""

    def __init__(self, building: Building, tracer: Tracer, folder: Path | None) -> None:
        """Nothing is traced yet; tables are stored in a folder if one is given."""
        self._building, self._tracer, self._folder = building, tracer, folder
        self._states: WeakKeyDictionary[RadioTable, tuple[Classifier, np.ndarray]] = WeakKeyDictionary()
        self._kept: OrderedDict[bytes, RadioTable] = OrderedDict()

    def of(self, place: Float[np.ndarray, "3"]) -> RadioTable:
        """The table of a transmitter at a place [m]; FileError if its file is damaged."""
        key = np.asarray(place, float).tobytes()
        if key not in self._kept:
            self._kept[key] = self._read_or_trace(np.asarray(place, float))
            if len(self._kept) > _KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]

    def states(
        self, place: Float[np.ndarray, "3"], sounder: Sounder, classifier: Classifier
    ) -> Float[np.ndarray, "nodes 4"]:
        """Probabilities of the link's states at the nodes of the table of a transmitter at a place [m]."""
        table = self.of(place)
        kept = self._states.get(table)
        if kept is None or kept[0] is not classifier:
            kept = classifier, states_of(table.links(), sounder, classifier)
            self._states[table] = kept
        return kept[1]

    def _read_or_trace(self, place: Float[np.ndarray, "3"]) -> RadioTable:
        file = None if self._folder is None else self._folder / f"{self._name(place)}.parquet"
        if file is not None and file.is_file():
            return RadioTable.read(file, self._building)
        table = RadioTable.trace(self._building, self._tracer, place)
        if file is not None:
            file.parent.mkdir(parents=True, exist_ok=True)
            table.write(file)
        return table

    def _name(self, place: Float[np.ndarray, "3"]) -> str:
        """Changes with whatever changes the paths."""
        made_from = (
            self._building.digest,
            place.tolist(),
            STEP_M,
            self._tracer.frequency_hz,
            self._tracer.config,
        )
        return "radio-" + hashlib.sha256(repr(made_from).encode()).hexdigest()[:24]

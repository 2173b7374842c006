"""Options of commands that trace radio."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from robosim.commands.option_help import ADVANCED
from robosim.parts import MaterialPart

if TYPE_CHECKING:
    from robosim.radio.scene import RadioConfig


@dataclass(frozen=True, kw_only=True)
class RadioOptions:
    """Which paths are traced."""

    frequency_ghz: float = 28.0
    """Carrier frequency [GHz]."""
    max_reflections: int = 3
    """Most reflections on a path without diffraction."""
    diffraction: bool = True
    """Whether edges diffract."""
    diffraction_reflections: Annotated[int, ADVANCED] = 1
    """Most reflections, before and after together, on a path with diffraction."""
    floor_ceiling: bool = False
    """Whether floor and ceiling reflect."""
    max_transmissions: Annotated[int | None, ADVANCED] = None
    """Most walls that a path passes; 2 below 10 GHz and none from there on if not given."""
    wall_passage: Annotated[Literal["wall", "face"], ADVANCED] = "wall"
    """What counts as a wall: both faces of a drawn wall together, or each face alone, as in the published grids."""
    wall_thickness: float | None = None
    """Thickness of walls of one --material, such as drywall [m]; half-spaces if not given."""
    wall_gap: Annotated[float, ADVANCED] = 0.0
    """Air between two layers of that thickness [m], such as 0.089 between plasterboards of 0.013; 0 for one layer."""
    scattering: float | None = None
    """How much walls scatter, coefficient S from 0 to 1; nothing if not given."""
    tolerance: float | None = None
    """Largest shift of walls that saves corners [m]; by default walls under staircases are straight, except in
    published grids; 0 keeps every cell."""
    max_paths: Annotated[int, ADVANCED] = 25
    """Most paths of a link; weaker ones are dropped."""
    material: MaterialPart = "partition"
    """Material of walls and furniture."""
    height: float = 1.5
    """Height of receivers, and of transmitters without one of their own [m]."""
    tx_power_dbm: float = 23.0
    """Transmit power [dBm]."""
    threshold_dbm: Annotated[float | None, ADVANCED] = None
    """Received power below which a path does not count for the link state [dBm]."""

    def config(self, polarisation: Literal["vertical", "horizontal", "both"] = "vertical") -> "RadioConfig":
        """The configuration of the simulator's radio."""
        from robosim.building.building import BuildingConfig
        from robosim.radio.scene import RadioConfig
        from wireless.tracing.tracer import TracerConfig

        return RadioConfig(
            frequency_hz=self.frequency_ghz * 1e9,
            height_m=self.height,
            tx_power_dbm=self.tx_power_dbm,
            threshold_dbm=self.threshold_dbm,
            tracer=TracerConfig(
                wall_thickness_m=self.wall_thickness,
                wall_gap_m=self.wall_gap,
                polarisation=polarisation,
                **{
                    name: getattr(self, name)
                    for name in vars(self).keys() & TracerConfig.__dataclass_fields__
                },
            ),
            building=BuildingConfig(
                tolerance_m=self.tolerance, wall_material=self.material, furniture_material=self.material
            ),
        )


#: As in the reference.
DEFAULT_RADIO = RadioOptions()

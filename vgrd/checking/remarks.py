"""What `vgrd check` says of one key."""

from dataclasses import dataclass

from vgrd.documents.toml_lines import KeyPlaces, Location


@dataclass(frozen=True, slots=True)
class Remark:
    """A message with its remedy about the key at `where`; a fault, or a doubt that stops nothing."""

    where: Location
    message: str
    is_fault: bool

    def to_json(self, places: KeyPlaces) -> dict[str, object]:
        """As `vgrd check --json` writes it."""
        line, key = places.line(self.where), places.key(self.where)
        return {"line": line, "key": key, "message": self.message}


def fault(message: str, *where: int | str) -> Remark:
    """Something that will fail."""
    return Remark(where, message, is_fault=True)


def doubt(message: str, *where: int | str) -> Remark:
    """Something that is odd, and may still be meant."""
    return Remark(where, message, is_fault=False)

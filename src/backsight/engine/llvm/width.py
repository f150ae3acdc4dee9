"""Number of lanes, and what follows from it in LLVM's language."""

import dataclasses
import struct


@dataclasses.dataclass(frozen=True)
class Width:
    """Number of lanes, and what follows from it.

    Parameters
    ----------
    lanes : int
    """

    lanes: int = 1

    @property
    def number(self) -> str:
        """Type of a number."""
        return "double" if self.lanes == 1 else f"<{self.lanes} x double>"

    @property
    def whole(self) -> str:
        """Type of a whole number of the same size."""
        return "i64" if self.lanes == 1 else f"<{self.lanes} x i64>"

    @property
    def truth(self) -> str:
        """Type of a condition."""
        return "i1" if self.lanes == 1 else f"<{self.lanes} x i1>"

    @property
    def suffix(self) -> str:
        """Type as part of the name of an intrinsic function."""
        return "f64" if self.lanes == 1 else f"v{self.lanes}f64"

    @property
    def attribute(self) -> str:
        """Attribute of functions, without which some processors cut wide vectors in two."""
        return f'"min-legal-vector-width"="{64 * self.lanes}"'

    def constant(self, value: float) -> str:
        """Write a number, the same in all lanes."""
        return self._everywhere(
            "double", f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"
        )

    def whole_constant(self, value: int) -> str:
        """Write a whole number, the same in all lanes."""
        return self._everywhere("i64", str(value))

    def _everywhere(self, kind: str, text: str) -> str:
        if self.lanes == 1:
            return text
        return "<" + ", ".join([f"{kind} {text}"] * self.lanes) + ">"

"""The devices that ship."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dynid import _dynid


class Devices(Mapping[str, _dynid.Device]):
    """Devices by their ids, read when they are asked for."""

    def __getitem__(self, id: str) -> _dynid.Device:
        if id not in _dynid.shipped():
            raise KeyError(id)
        return _dynid.Device._shipped(id)

    def __iter__(self) -> Iterator[str]:
        return iter(_dynid.shipped())

    def __len__(self) -> int:
        return len(_dynid.shipped())

    def __repr__(self) -> str:
        return f"<dynid.devices: {', '.join(self)}>"


devices = Devices()

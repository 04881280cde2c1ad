"""Skin files: which bodies a binary `.skn` hangs on."""

from __future__ import annotations

import struct

_HEADER = struct.Struct("<4i")
_NAME_BYTES = 40
_BIND_FLOATS = 7


def bone_names(content: bytes) -> tuple[str, ...]:
    """The bodies that a skin's bones belong to.

    A file holds the numbers of vertices, texture coordinates, faces and bones, then their arrays, and for each bone: a
    name of 40 bytes, position and quaternion, the number of its vertices, their indices and their weights (MuJoCo's
    XML reference, `asset/skin`).

    Args:
        content: The bytes of the file.

    Returns:
        The names in the file's order; none where the bytes are no skin.
    """
    names = []
    try:
        vertices, coordinates, faces, bones = _HEADER.unpack_from(content)
        if min(vertices, coordinates, faces, bones) < 0:
            return ()
        offset = _HEADER.size + 4 * (3 * vertices + 2 * coordinates + 3 * faces)
        for _ in range(bones):
            name = content[offset : offset + _NAME_BYTES].split(b"\0")[0].decode()
            offset += _NAME_BYTES + 4 * _BIND_FLOATS
            (weights,) = struct.unpack_from("<i", content, offset)
            if weights < 0:
                return ()
            offset += 4 + 8 * weights
            names.append(name)
    except (struct.error, UnicodeDecodeError):
        return ()
    return tuple(names)

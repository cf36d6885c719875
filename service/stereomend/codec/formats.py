"""Which format a file is in, by its first bytes; names and media types are not trusted."""

from __future__ import annotations

from stereomend.codec import arrays, bmp, jpeg, netpbm, png, tiff
from stereomend.codec.headers import Header
from stereomend.errors import DamagedFile, UnknownFormat

_READERS = (
    (png.SIGNATURE, png.read_header),
    (jpeg.SIGNATURE, jpeg.read_header),
    (tiff.SIGNATURES + tiff.BIG_SIGNATURES, tiff.read_header),
    (arrays.SIGNATURE, arrays.read_header),
    (netpbm.PFM_SIGNATURES, netpbm.read_pfm),
    (netpbm.PNM_SIGNATURES, netpbm.read_pnm),
    (bmp.SIGNATURE, bmp.read_header),
)

# Only for messages: what people send by mistake.
_OTHERS = (
    (b"PK\x03\x04", "a ZIP archive (NPZ is one)"),
    (b"PK\x05\x06", "an empty ZIP archive"),
    (b"%PDF", "a PDF"),
    (b"GIF8", "a GIF"),
    (b"\x76\x2f\x31\x01", "an OpenEXR image"),
    (b"\x1f\x8b", "a gzip archive"),
    (b"7z\xbc\xaf", "a 7z archive"),
    (b"\x89HDF", "an HDF5 file"),
    (b"MATLAB", "a MATLAB file"),
    (b"RIFF", "a RIFF file (WebP or AVI)"),
    (b"\0\0\0\x0cjP", "a JPEG 2000 image"),
    (b"\xffO\xffQ", "a JPEG 2000 image"),
    ((b"P1", b"P2", b"P3", b"P4", b"P7"), "a PNM that is text, one-bit or PAM"),
    (b"<", "HTML or XML"),
    ((b"{", b"["), "JSON"),
    (b"\x80", "a Python pickle"),
)


def read_header(data: bytes, expected: str) -> Header:
    """Read what a file promises; `expected` says in messages what would do.

    Raises:
        DamagedFile: the file is empty, or its header cut off or corrupt.
        UnknownFormat: the file is in no format read here, or in a variant that is not.
    """
    if not data:
        raise DamagedFile(f"the file is empty; expected {expected}")
    for signature, read in _READERS:
        if data.startswith(signature):
            return read(data)
    raise UnknownFormat(f"{_guess(data)}; expected {expected}")


def _guess(data: bytes) -> str:
    if data[128:132] == b"DICM":
        return "a DICOM file"
    for signature, what in _OTHERS:
        if data.startswith(signature):
            return what
    return f"a file that starts with the bytes {data[:8].hex(' ')}"

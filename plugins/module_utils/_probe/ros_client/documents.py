# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""XML-RPC documents from strangers, read with bounds: bytes, unpacked bytes, nesting, memory.

Both sides of a call use this. The modules have a copy (plugins/module_utils/_probe/ros_client/documents.py, tools/copies.py), so it runs
on Python 3.6 and needs nothing.
"""

import typing
import xml.parsers.expat
import xmlrpc.client
import zlib

MAX_REQUEST = 1 << 20  # bytes, also unpacked, as the following ones
ANSWER = 1 << 16  # of an answer of another computer
NODE = 2 << 20  # of a node of this robot: rosbag may have a thousand connections
STATE = 16 << 20  # of the state of a master, or of a roscore: 5,000 topics are 3 MB

_NESTING = 100  # elements within each other: a list in a list has three
_NUMBER = 400  # digits: Python before 3.11 takes seconds for a long one, and everything waits
_PIECE = 1 << 16  # bytes that are unpacked and read at once
_TOKEN = 1 << 17  # bytes of one token of XML, such as a comment
_TEXT = 4 << 20  # bytes of memory of one text
_ELEMENT = 40  # bytes of memory that an element costs about, besides its text
_ROOMY = (
    56  # and one of these more, or a list that is in no value; a number of <bigdecimal> takes most, with Python 3.13
)
_ROOMY_TAGS = ("struct", "bigdecimal")
_HEAD, _WIDE_HEAD = 20, 44  # and a text that is in no element of its own within a value, of ASCII and of other signs
_DEAR = 24 << 20  # bytes of memory of any document: 5,000 topics are 6 MB
_SPARE = 1 << 20  # bytes of memory: a document of a library costs less than this and twice its length
_NUMBERS = ("int", "i1", "i2", "i4", "i8", "biginteger", "bigdecimal", "double")

Bytes = typing.Union[bytes, bytearray]
Values = typing.Tuple[typing.Tuple[typing.Any, ...], typing.Optional[str]]


class DocumentTooLarge(ValueError):
    """A document that costs more than is taken; its text says which limit was hit."""


_is_ascii: typing.Callable[[str], bool] = getattr(str, "isascii", lambda text: max(text) < "\x80")  # Python 3.7
_start, _end = xmlrpc.client.Unmarshaller.start, xmlrpc.client.Unmarshaller.end


class _Reader(xmlrpc.client.Unmarshaller):
    """Makes values of a document, as long as it is neither deep nor dear."""

    def __init__(self, dear: int, longest: int, plain_types: bool) -> None:
        xmlrpc.client.Unmarshaller.__init__(self, use_builtin_types=plain_types)
        self._depth, self._left, self._size, self._width, self._head = 0, dear, 0, 1, _HEAD
        self._most, self._longest, self._alone, self._value = dear, longest, True, False

    # These three are called for each element, of which a state has thousands: they call as little as can be.

    def start(self, tag: str, attrs: typing.Dict[str, str]) -> None:
        self._depth, self._size, self._width, self._head = self._depth + 1, 0, 1, _HEAD
        if self._depth > _NESTING:
            raise DocumentTooLarge(f"more than {_NESTING} elements within each other")
        self._alone = not self._value  # the element before this one is no value, so this one is not in it
        is_roomy = tag in _ROOMY_TAGS or (self._alone and tag == "array")
        self._left -= _ELEMENT + _ROOMY if is_roomy else _ELEMENT
        if self._left < 0:
            self._refuse()
        _start(self, tag, attrs)

    def data(self, text: str) -> None:
        if self._width < 4 and not _is_ascii(text):
            self._head = _WIDE_HEAD
            widest = max(text)  # one such character makes all of a text wide
            width = 4 if widest > "\uffff" else 2 if widest > "\xff" else 1
            if width > self._width:
                self._left -= self._size * (width - self._width)
                self._width = width
        self._size += len(text)
        self._left -= len(text) * self._width
        if self._left < 0:
            self._refuse()
        if self._size * self._width > self._longest:
            raise DocumentTooLarge(f"a text of more than {self._longest} bytes")
        self._data.append(text)

    def end(self, tag: str) -> None:
        self._depth -= 1
        if self._size > _NUMBER and tag.split(":")[-1] in _NUMBERS:
            raise ValueError(f"a number of more than {_NUMBER} digits")
        _end(self, tag)
        if self._size and self._alone:
            self._left -= self._head
            if self._left < 0:
                self._refuse()
        if self._size:  # else an element around this one would have its text again
            self._data.clear()
        self._size, self._width, self._head = 0, 1, _HEAD

    def _refuse(self) -> None:
        raise DocumentTooLarge(f"its values take more than {self._most >> 20} MiB of memory")


def _refuse_document_type(*_declaration: typing.Any) -> None:
    raise ValueError("a document type in an XML-RPC document")


class Document:
    """A document that is read piece by piece. Every method raises ValueError, an error of expat or xmlrpc, or a Fault."""

    def __init__(self, most: int, dear: int = _DEAR, longest: int = _TEXT, plain_types: bool = True) -> None:
        """`most`: bytes of the document; `dear`: of memory of its values; `longest`: of memory of one text.

        `plain_types`: bytes and datetime, and not the classes of xmlrpc.client, which write the same again.
        """
        self._most, self._fed = most, 0
        self._reader = _Reader(min(2 * most, dear) + _SPARE, longest, plain_types)
        self._reader.xml("", None)  # its texts are decoded already
        # In UTF-8 whatever it says: in another encoding a document type would not be seen.
        self._parser = parser = xml.parsers.expat.ParserCreate("utf-8")
        parser.buffer_text = True  # else each line break of a long text is one object
        parser.StartDoctypeDeclHandler = _refuse_document_type
        parser.StartElementHandler = self._reader.start
        parser.EndElementHandler = self._reader.end
        parser.CharacterDataHandler = self._reader.data

    def feed(self, data: Bytes) -> None:
        """Read a piece."""
        for piece in _split(data):
            self._fed += len(piece)
            if self._fed > self._most:
                raise DocumentTooLarge(f"it has more than {self._most} bytes")
            self._parser.Parse(piece, False)
            if self._fed - max(self._parser.CurrentByteIndex, 0) > _TOKEN:
                raise DocumentTooLarge(f"a token of more than {_TOKEN} bytes")

    def close(self) -> Values:
        """The values, and the name of the method if it is a call."""
        self._parser.Parse(b"", True)
        return self._reader.close(), self._reader.getmethodname()


def unpack(pieces: typing.Iterable[Bytes], most: int) -> typing.Iterator[bytes]:
    """Unpack gzip in pieces, up to `most` bytes. Raises ValueError for more, or for other bytes than gzip."""
    unpacker, size = zlib.decompressobj(31), 0
    try:
        for rest in pieces:
            while rest and not unpacker.eof:
                piece = unpacker.decompress(rest, _PIECE)
                rest = unpacker.unconsumed_tail
                size += len(piece)
                if size > most:
                    raise DocumentTooLarge(f"it has more than {most} bytes")
                yield piece
    except zlib.error as problem:
        raise ValueError(str(problem)) from None
    if not unpacker.eof:
        raise ValueError("the end of the packed text is missing")


def _split(data: Bytes) -> typing.Iterator[Bytes]:
    return (data[at : at + _PIECE] for at in range(0, len(data), _PIECE))


def loads(body: Bytes, most: int = STATE, packed: bool = False) -> Values:
    """The values and the method of an XML-RPC document. Document types and entities are not read."""
    document = Document(most)
    for piece in unpack(_split(body), most) if packed else (body,):
        document.feed(piece)
    return document.close()

"""The sources of MAP.yaml with ranges to anchors, or with differences of ranges."""

from typing import Literal, Self

from pydantic import Field, model_validator

from ortilo_drake.interop.recorded.anchors import key_of
from ortilo_drake.interop.recorded.sources import MOST, Column, Name, Source
from ortilo_drake.model.typed_yaml import Positive


class AnchoredSource(Source):
    """A source whose rows hold ranges from tags to anchors, or differences of ranges."""

    tag: Column | tuple[Column, Column] | None = Field(
        default=None,
        description="The column that names the tag of each row, or two that do so together, as `200.1`; see `tags`.",
    )
    names: tuple[Name, ...] = Field(
        default=(), max_length=MOST, description="What the rows call the anchors, in the order of `anchors`; as text."
    )
    scale: Positive = Field(default=1.0, description="Metres in one of the file's units.")

    @property
    def tag_columns(self) -> tuple[Column, ...]:
        """The columns that together name the tag of each row; empty if rows name no tag."""
        return () if self.tag is None else self.tag if isinstance(self.tag, tuple) else (self.tag,)


class RangeSource(AnchoredSource):
    """Ranges to anchors [m]: a column or field for each anchor, rows that name an anchor, or a file for each anchor."""

    format: Literal["columns", "lec"] = Field(
        default="columns", description="`lec`: lines of DWM1001's console (`lec` or `les`), a stamp before each."
    )
    values: tuple[Column, ...] = Field(
        default=(), max_length=MOST, description="A column for each anchor; or one field that is a list."
    )
    anchor: Column | None = Field(default=None, description="Rows of one range: the column that names the anchor.")
    topics: tuple[str, ...] = Field(default=(), description="A topic for each anchor, in place of `topic`.")

    @property
    def rows_name_anchors(self) -> bool:
        """Whether each row holds one range and names its anchor."""
        return self.anchor is not None or self.format == "lec"

    @property
    def a_file_each(self) -> bool:
        """Whether there is a table for each anchor, in order, with one range in each row."""
        several = len(self.file) > 1 if isinstance(self.file, tuple) else any(mark in self.file for mark in "*?[")
        one = len(self.values) == 1 and not self.rows_name_anchors
        return several and one and self.topic is None and not self.topics

    @property
    def anchor_count(self) -> int | None:
        """The number of anchors with ranges; None if it is known only when the files are read."""
        if self.rows_name_anchors or self.names:
            return len(self.names) or None
        if self.topics or not (self.a_file_each or self.anchors_of_files):
            is_list = self.topic is not None and len(self.values) == 1
            return len(self.topics) or (None if is_list else len(self.values))
        return None

    @model_validator(mode="after")
    def _a_row_says_what_it_is_of(self) -> Self:
        of_files = self.anchors_of_files
        no_lec = (self.values, self.anchor, self.tag, self.topic, self.topics)
        if self.format == "lec" and any(key not in (None, ()) for key in no_lec):
            raise ValueError("format: lec: its lines say what is what; leave `values`, `anchor`, `tag` and topics out")
        if self.format == "columns" and not self.values:
            raise ValueError("values: is missing: the column of each anchor's range, or of the one range of a row")
        if self.names and not (self.rows_name_anchors or of_files):
            raise ValueError("names: belong to `anchor`, which names the anchor of each row; give both or neither")
        if (self.anchor is not None or self.topics or of_files) and len(self.values) != 1:
            raise ValueError(f"values: {len(self.values)} columns, where every row has one range")
        if self.topics and (self.anchor is not None or self.topic is not None):
            raise ValueError("topics: stand in place of `topic` and `anchor`; leave those out")
        if of_files and (len(of_files) < len(self.file) or self.rows_name_anchors or self.topics):
            raise ValueError("file: either every file names its anchor, or none does and the rows or topics say it")
        of_tags = self.tags_of_files
        if of_tags and (len(of_tags) < len(self.file) or self.tag is not None):
            raise ValueError("file: either every file names its tag, or none does and `tag` is the rows' column")
        if self.tag is not None and (self.topics or self.a_file_each or of_files):
            raise ValueError("tag: rows name it beside their anchor, or have a range to each")
        for called in (self.names, of_files):
            keys = [key_of(name) for name in called]
            for i, key in enumerate(keys):
                if key in keys[:i]:
                    raise ValueError(f"{'names' if called is self.names else 'file'}: '{called[i]}' stands twice")
        return self

    @model_validator(mode="after")
    def _table_has_stamps(self) -> Self:
        if self.topic is None and not self.topics and self.time is None and self.format == "columns":
            raise ValueError("time: a table needs the column of its stamps (a bag needs `topic`)")
        return self


class DifferenceSource(AnchoredSource):
    """Differences r_b - r_a of the ranges to two anchors [m], one in each row."""

    value: Column
    a: Column = Field(description="The column that names anchor a.")
    b: Column = Field(description="The column that names anchor b.")
    sign: Literal[1, -1] = Field(default=1, description="1: a value is r_b - r_a; -1: it is r_a - r_b.")

"""Capture files: one module per format, one literal registry, one way to read and to write.

A format module has

- ``SUFFIXES``: lower-case file name endings;
- ``sniff(head)``: whether the first 512 bytes of a file look like this format;
- ``read(path, options)``: the Take, with the document kept in ``take.origin`` so that nothing is lost;
- ``write(take, path, *, invalidate=False)``: copies the kept document to ``path`` (a temporary name, never the
  input) with the ``filled`` samples replaced, and returns the Take as the new file holds it: positions as stored,
  ``filled`` reduced to what the format could express, findings that tell the difference. With ``invalidate``
  samples neither trusted nor filled are marked missing, where the format has such a mark;
- ``prove(take, path)``: reads ``path`` back and raises FormatError unless it holds just what ``take`` (the return
  of ``write``) says and is identical to the kept document everywhere else;
- ``create(take, path)``: a brand-new file from a take that was never in one.
"""

"""Files and words that a run leaves behind: plain arrays in, files and lines of text out.

Nothing here knows the model or the engines. Each module imports its library (h5py, matplotlib, rich) when first used.

vtkhdf    temporal VTKHDF series that ParaView opens      table     history.csv, one row per record
folder    result folder, JSON files, provenance           figures   PNG and SVG figures in one style
progress  the live line of a run                          report    the closing block of a run
readable  numbers and times as people write them        sheet     a page of pictures, tables and remarks
render    pictures of spheres, cut open, by casting rays; its colours: colouring; several in one: plate
viewer    a model to turn in the browser, one file; its page: viewer.html
"""

"""The commands of `ispom`: each file here is one, named as the file, with its `Options` and what `execute`s it."""

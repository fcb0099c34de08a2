"""The words, colours and HTML in which results are shown, the same in every view."""

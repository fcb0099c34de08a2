"""Methods in other languages: a program gets frames through a pipe and answers with poses."""

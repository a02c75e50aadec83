"""Ways out: sessions -> the files of other tools."""

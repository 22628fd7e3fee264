"""What ``import homolog`` gives beyond other parts' own names: shapes in memory in, arrays out."""

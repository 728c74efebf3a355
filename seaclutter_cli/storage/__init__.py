"""Places of files outside the program: local paths and object storage, copies in the scratch folder, uploads."""

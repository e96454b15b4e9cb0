"""Storage: what each owner keeps on the disk, how it is deleted, and for how long records are kept."""

"""A site's scan handed to the elements in it: points in, a bounded number of points for each element out."""

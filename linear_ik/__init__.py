"""As-built shape of linear building elements from laser scans."""

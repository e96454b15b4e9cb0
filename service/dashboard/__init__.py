"""The dashboard: pages that read the REST interface in the browser, and the replay."""

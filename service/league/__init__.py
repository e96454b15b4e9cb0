"""The league of dohyo's own systems, for the dashboard: standings of the rows that come with dohyo."""

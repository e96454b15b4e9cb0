# The service and the command `dohyo`: CPU build of torch, no tools of development. `.ci/image` builds it and tries it.
ARG BASE=python:3.11-slim-bookworm

# hadolint ignore=DL3006
FROM ${BASE} AS libraries
ARG PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
ARG PIP_FIND_LINKS=
ENV PIP_NO_CACHE_DIR=1 \
    PIP_DISABLE_PIP_VERSION_CHECK=1
# hadolint ignore=DL3008,DL3009
RUN apt-get update && apt-get install -y --no-install-recommends binutils
# pip stays in an environment of its own. PyPI's torch brings CUDA, so only the CPU build is accepted.
RUN python3 -m venv /opt/pip && python3 -m venv --without-pip /opt/dohyo
WORKDIR /build
COPY pyproject.toml .ci/slim ./
RUN python3 -c 'import re, tomllib; needed = tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"]; \
        print(*(re.sub("^torch==.*", r"\g<0>+cpu", one) for one in needed), sep="\n")' > requirements.txt \
    && /opt/pip/bin/pip --python /opt/dohyo/bin/python install --no-compile -r requirements.txt \
    && ./slim /opt/pip/bin/pip /opt/dohyo

FROM libraries AS wheel
COPY . .
RUN /opt/pip/bin/pip --python /opt/dohyo/bin/python install --no-deps --root /only .

# hadolint ignore=DL3006
FROM ${BASE}
# The system libraries that SUMO's wheels are linked to but do not bring (see SYSTEM_PACKAGES in the Makefile). Nothing
# draws here: OpenGL's drivers with their compiler go, 200 MB. The base image's pip goes too.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgl1 libx11-6 libxext6 libxrender1 libatomic1 \
    && rm -rf /var/lib/apt/lists/* /var/cache/apt/*.bin /usr/lib/*/dri /usr/lib/*/libLLVM* /usr/lib/*/libz3.so* \
        /usr/lib/*/libicu* /usr/local/bin/pip* /usr/local/bin/wheel /usr/local/lib/python3*/ensurepip \
        /usr/local/lib/python3*/site-packages/* \
    && useradd --create-home --uid 1000 dohyo \
    && install -d -o dohyo -g dohyo /data
COPY --from=libraries /opt/dohyo /opt/dohyo
COPY --from=wheel /only/opt/dohyo /opt/dohyo
ENV PATH=/opt/dohyo/bin:$PATH \
    ORT_DISABLE_TELEMETRY=1 \
    DOHYO_DATA=/data \
    DOHYO_HOST=0.0.0.0 \
    DOHYO_PORT=8000 \
    DOHYO_INSECURE=true
USER 1000:1000
WORKDIR /home/dohyo
RUN python -m dohyo.sumo_networks.networks.catalog
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=10s --start-period=60s CMD \
    ["python", "-c", "import os, urllib.request as web; host = os.environ['DOHYO_HOST']; own = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(host, host); web.urlopen('http://%s:%s/health/ready' % ('[%s]' % own if ':' in own else own, os.environ['DOHYO_PORT']), timeout=8)"]
CMD ["dohyo", "serve"]

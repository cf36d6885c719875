# Any Debian or Ubuntu image whose Python is 3.11 or newer.
ARG BASE=debian:bookworm-slim

FROM ${BASE} AS build

# Pinned packages would vanish from the mirrors with the next security update.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends g++ python3-dev python3-venv \
    && rm -rf /var/lib/apt/lists/*

RUN python3 -m venv /opt/stereomend
ENV PATH=/opt/stereomend/bin:$PATH
WORKDIR /src

# The dependencies first: an edited source does not fetch them again.
COPY pyproject.toml .
RUN python3 -c "import tomllib; \
project = tomllib.load(open('pyproject.toml', 'rb'))['project']; \
print(*project['dependencies'], sep='\n')" > /tmp/requirements.txt \
    && pip install --no-cache-dir --requirement /tmp/requirements.txt

# The image needs no installer, so none is left in it.
COPY . .
RUN pip install --no-cache-dir . \
    && pip uninstall --yes pip setuptools


FROM ${BASE}

# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends libstdc++6 python3 \
    && rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/cache/debconf/*-old /var/log/apt /var/log/*.log \
    && useradd --uid 10001 --user-group --no-log-init --no-create-home --home-dir /nonexistent \
        --shell /usr/sbin/nologin stereomend \
    && install --directory --owner 10001 --group 10001 --mode 0700 /data

COPY --from=build /opt/stereomend /opt/stereomend

# Every address of the container: the server then refuses to start without STEREOMEND_API_KEYS.
ENV PATH=/opt/stereomend/bin:$PATH \
    STEREOMEND_HOST=0.0.0.0 \
    STEREOMEND_PORT=8000 \
    STEREOMEND_DATA_DIR=/data

LABEL org.opencontainers.image.title="Stereomend" \
      org.opencontainers.image.description="Mends disparity maps of laparoscopic stereo pairs" \
      org.opencontainers.image.licenses="Apache-2.0"

# Accepted jobs and their results; what is not in a named volume is lost with the container.
VOLUME /data

EXPOSE 8000
STOPSIGNAL SIGTERM

# A number, so that an orchestrator can see that it is not root.
USER 10001:10001
WORKDIR /

# Not urllib: it would send this through an http_proxy of the container. The certificate names no loopback.
HEALTHCHECK --interval=30s --timeout=10s --start-period=30s --retries=3 \
    CMD ["python3", "-c", "import http.client, os, ssl, sys; \
where = '127.0.0.1', os.environ['STEREOMEND_PORT']; \
server = http.client.HTTPSConnection(*where, timeout=5, context=ssl._create_unverified_context()) \
if os.environ.get('STEREOMEND_TLS_CERTFILE') else http.client.HTTPConnection(*where, timeout=5); \
server.request('GET', '/readyz'); \
sys.exit(server.getresponse().status != 200)"]

ENTRYPOINT ["stereomend"]
CMD ["serve"]

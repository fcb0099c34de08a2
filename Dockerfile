# docker build -t ispom . && docker run --rm -p 127.0.0.1:8090:8090 -v "$PWD/recordings:/data:ro" ispom
# The printed address has the token. compose.yaml and docs/howto/server.md have a proxy with TLS.
FROM python:3.12-slim

# Open3D, which makes the surfaces of `ispom map`, loads these libraries; nothing else needs them.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libegl1 libgl1 libgomp1 libidn2-0 libudev1 libusb-1.0-0 libx11-6 \
    && rm -rf /var/lib/apt/lists/*

COPY . /src
RUN pip install --no-cache-dir "/src[bags,fusion,plots]" && rm -rf /src

# Compiled code, rendered images, recordings and progress go to the user's home: a volume keeps them.
RUN useradd --create-home --uid 1000 ispom && mkdir /data && chown ispom /data
USER ispom
WORKDIR /home/ispom
VOLUME /home/ispom
EXPOSE 8090

ENTRYPOINT ["ispom"]
CMD ["app", "--host", "0.0.0.0", "--no-browser", "--root", "/data"]

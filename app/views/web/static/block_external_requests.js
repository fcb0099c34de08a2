// The Rerun viewer asks other hosts for fonts, updates and statistics. The page's security policy forbids it; answering
// here keeps the browser's console clean. Its thousands of debug lines are not for anyone here, and slow its start.
{
  console.debug = () => {};
  const fetchOwn = window.fetch.bind(window);
  const own = (url) => ["blob:", "data:"].includes(url.protocol) || url.origin === location.origin;
  window.fetch = (request, options) => {
    const url = new URL(request instanceof Request ? request.url : request, location.href);
    return own(url) ? fetchOwn(request, options) : Promise.resolve(new Response(null, { status: 204 }));
  };
}
